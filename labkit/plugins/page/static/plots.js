"use strict";
// Draws curves and the rose as SVG. What is drawn, its labels and units come from labkit (labkit/plugins/page/panels.py).
const LOOKS = [["#1f5fa8", ""], ["#c8402f", "6 4"], ["#2a8a57", "2 3"]];
const [WIDE, HIGH, LEFT, RIGHT, TOP, BOTTOM] = [360, 240, 46, 348, 10, 198];

function escaped(text) { return String(text).replace(/[&<>"]/g, (letter) => `&#${letter.charCodeAt(0)};`); }

function ticks(low, high) {  // at most six round numbers
  const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((n) => n * power >= rough * 0.999);
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => Number(((first + k) * step).toPrecision(10)));
}

function range(values, flat) {  // the smallest interval with a margin; a constant is drawn in the middle
  const low = Math.min(...values), high = Math.max(...values), room = Math.max(0.04 * (high - low), flat * Math.abs(high), 0.01);
  return [low - room, high + room];
}

function curve(rows, x, y, X, Y) {
  const points = rows.filter((row) => row && row[x] !== null && row[y] !== null);
  return points.map((row, k) => `${k ? "L" : "M"}${X(row[x]).toFixed(1)} ${Y(row[y]).toFixed(1)}`).join("");
}

function plot(panel, runs) {  // the SVG of a panel; the last run is drawn in colour, earlier ones in grey
  const values = (key) => runs.flat().filter(Boolean).map((row) => row[key]).filter((value) => value !== null && value !== undefined);
  const xs = values(panel.x), ys = panel.curves.flatMap((one) => values(one.key));
  if (!xs.length || !ys.length) return "";
  const [x0, x1] = range(xs, 0.002), [y0, y1] = range(ys, 0.02);
  const X = (x) => LEFT + ((x - x0) / (x1 - x0)) * (RIGHT - LEFT), Y = (y) => BOTTOM - ((y - y0) / (y1 - y0)) * (BOTTOM - TOP);
  let out = "";
  for (const t of ticks(x0, x1)) out += `<path d="M${X(t)} ${TOP}V${BOTTOM}" stroke="#eef1f4"/><text x="${X(t)}" y="${BOTTOM + 14}" text-anchor="middle">${t}</text>`;
  for (const t of ticks(y0, y1)) out += `<path d="M${LEFT} ${Y(t)}H${RIGHT}" stroke="#eef1f4"/><text x="${LEFT - 5}" y="${Y(t) + 4}" text-anchor="end">${t}</text>`;
  out += `<path d="M${LEFT} ${TOP}V${BOTTOM}H${RIGHT}" fill="none" stroke="#8b97a3"/>`;
  runs.forEach((rows, n) => panel.curves.forEach(({ key, look }) => {
    const [color, dash] = LOOKS[look], last = n === runs.length - 1, d = curve(rows, panel.x, key, X, Y);
    out += `<path d="${d}" fill="none" stroke="${last ? color : "#b9c2cb"}" stroke-width="${last ? 2 : 1.4}" stroke-dasharray="${dash}"/>`;
  }));
  const now = runs.at(-1).at(-1);
  if (now) panel.curves.forEach(({ key, look }) => {
    if (now[panel.x] !== null && now[key] !== null) out += `<circle cx="${X(now[panel.x])}" cy="${Y(now[key])}" r="3.2" fill="${LOOKS[look][0]}"/>`;
  });
  const label = `<text x="${(LEFT + RIGHT) / 2}" y="${HIGH - 8}" text-anchor="middle">${escaped(panel.x_axis)}</text>`;
  return `<svg viewBox="0 -16 ${WIDE} ${HIGH + 16}" role="img" aria-label="${escaped(panel.title)}">`
    + `<text x="4" y="-4">${escaped(panel.y_axis)}</text>${out}${label}</svg>`;
}

function legend(panel) {
  const shown = panel.curves.filter((one) => one.legend);
  return shown.map(({ look, legend }) => `<span><i style="border-top: 2.5px ${["solid", "dashed", "dotted"][look]} ${LOOKS[look][0]}"></i>${escaped(legend)}</span>`).join("");
}

function drawn_rose({ density, fit }) {  // angles from z (up) towards x (right); the other half is the same
  const most = Math.max(1.5, ...density, ...fit), scale = 105 / most, [cx, cy] = [180, 128];
  const at = (angle, size) => `${(cx + size * scale * Math.sin(angle)).toFixed(1)} ${(cy - size * scale * Math.cos(angle)).toFixed(1)}`;
  let out = "";
  const rings = ticks(0, most).filter((t) => t > 0);
  for (const ring of rings) out += `<circle cx="${cx}" cy="${cy}" r="${ring * scale}" fill="none" stroke="${ring === 1 ? "#8b97a3" : "#e3e8ed"}"/>`;
  const width = Math.PI / density.length;
  for (const half of [0, Math.PI]) density.forEach((size, k) => {
    const [a, b] = [half + k * width, half + (k + 1) * width];
    out += `<path d="M${cx} ${cy}L${at(a, size)}A${size * scale} ${size * scale} 0 0 1 ${at(b, size)}Z" fill="#9fc0e4" stroke="#fff" stroke-width="0.6" fill-opacity="0.85"/>`;
  });
  const whole = [...fit, ...fit.slice(1)], step = Math.PI / (fit.length - 1);
  out += `<path d="${whole.map((size, k) => `${k ? "L" : "M"}${at(k * step, size)}`).join("")}" fill="none" stroke="#c8402f" stroke-width="2"/>`;
  for (const ring of rings) out += `<text x="${cx + 0.7 * ring * scale}" y="${cy + 0.7 * ring * scale}" class="ring">${ring}</text>`;
  return out + `<text x="${cx}" y="14" text-anchor="middle">z</text><text x="${cx + 118}" y="${cy + 4}">x</text>`
    + `<text x="6" y="250" fill="#5b6875">1: as if all directions were alike</text>`;
}
