"use strict";
// The page: a form made from labkit's tables, the thread that computes, and the panels. No physics and no list of
// parameters is here: they come in page.json and in the messages of labkit/plugins/page/bench.py.
const element = (id) => document.getElementById(id);
const fields = () => [...element("form").querySelectorAll("[data-group]")];
let site, worker, panels = [], runs = [], finished = true, made = false, opened = false;
let asked, compared, specimen, running;  // the exercise, its numbers, the file of its specimen; the last test
const LACK = "The browser has no more memory: close other pages or choose fewer grains, and run again.";

// --- the form --------------------------------------------------------------------------------------------------------
function field(group, { name, words, help, unit, choices, default: standard }) {
  const control = choices
    ? `<select data-group="${group}" name="${name}">${choices.map((one) => `<option${one === standard ? " selected" : ""}>${escaped(one)}</option>`).join("")}</select>`
    : `<input data-group="${group}" name="${name}" value="" placeholder="${escaped(standard)}">`;
  return `<label title="${escaped(help)}">${escaped(words)} <i>${escaped(unit)}</i>${control}</label>`;
}

function show_parameters() {  // of the chosen path
  const path = site.paths[element("path").value];
  element("summary").textContent = path.summary;
  element("parameters").innerHTML = path.fields.map((one) => field("path", one)).join("");
}

function chosen() {  // what the form says, by group
  const texts = { path: { name: element("path").value } };
  for (const one of fields()) if (one.value) (texts[one.dataset.group] ??= {})[one.name] = one.value;
  return texts;
}

function preset(texts) {
  element("path").value = texts.path.name;
  show_parameters();
  for (const one of fields()) {
    const value = texts[one.dataset.group]?.[one.name];
    if (value !== undefined || one.tagName === "INPUT") one.value = value ?? "";
    else one.value = [...one.options].find((option) => option.defaultSelected)?.value ?? one.options[0].value;
  }
}

function show_exercise(exercise, number) {
  const test = exercise.tests[number];
  const links = exercise.tests.map((one, k) => `<a class="button${k === number ? " chosen" : ""}" href="?exercise=${exercise.name}&test=${k}">${escaped(one.title)}</a>`);
  const numbers = test.numbers.map((one) => `<tr><td>${escaped(one.words)}</td><td>${shown(one.value)}</td><td></td></tr>`).join("");
  element("exercise").innerHTML = `<h2>${escaped(exercise.title)}</h2><p>${escaped(exercise.question)}</p><nav>${links.join("")}</nav>`
    + `<details><summary>What comes out</summary><p>${escaped(exercise.answer)}</p>`
    + `<table><tr><th></th><th>labkit on a computer</th><th>this page</th></tr>${numbers}</table></details>`;
  element("exercise").hidden = false;
  preset(test.choices);
  [asked, compared, specimen] = [JSON.stringify(chosen()), test.numbers, test.specimen];
}

function shown(number) { return Number(number.toPrecision(4)); }

function compare() {  // the numbers of the exercise with those of the test that just ended
  document.querySelectorAll("#exercise td:last-child").forEach((cell, k) => {
    const values = runs.at(-1).map((row) => row[compared[k].key]).filter((value) => value !== null);
    const largest = values.reduce((most, value) => (Math.abs(value) > Math.abs(most) ? value : most), 0);
    cell.textContent = shown({ start: values[0], largest, end: values.at(-1) }[compared[k].at]);
  });
}

function choose(query) {  // the exercise in the address; no reload, so that the curves of its tests lie side by side
  const wanted = new URLSearchParams(query), name = wanted.get("exercise");
  const exercise = site.exercises.find((one) => one.name === name) ?? site.exercises[0];
  show_exercise(exercise, Math.min(Number(wanted.get("test")) || 0, exercise.tests.length - 1));
  document.querySelectorAll("#exercises a").forEach((link) => link.classList.toggle("chosen", link.dataset.name === exercise.name));
}

// --- the thread that computes ----------------------------------------------------------------------------------------
function open_worker() {
  worker?.terminate();
  [worker, made, opened] = [new Worker("worker.js"), false, false];
  runs.push([]);  // files can be written only of what this worker computes
  enable(true);
  element("run").disabled = true;
  worker.onmessage = ({ data }) => listen(data);
  worker.onerror = () => listen({ lack: true, fatal: true });
  worker.postMessage({ call: "open", given: [{ pyodide: new URL(site.pyodide, location).href, wheel: site.wheel }] });
}

function ask(call, ...given) { worker.postMessage({ call, given }); }

function say(text, done) {
  element("status").textContent = text;
  if (done !== undefined) element("done").value = done;
}

function fail(text, fatal = false) {
  element("error").textContent = text;
  element("error").hidden = false;
  say(fatal ? "" : "not run", 0);
  enable(true);
  if (fatal) element("run").disabled = true;
}

function enable(over) {  // buttons for a test that is over, or that runs
  finished = over;
  element("run").disabled = false;
  element("pause").disabled = element("end").disabled = over;
  for (const id of ["go_on", "records", "run_file", "state_file"]) element(id).disabled = !runs.at(-1)?.length;
  if (opened) element("go_on").disabled = element("state_file").disabled = !over;
}

async function begin(call) {
  element("error").hidden = true;
  document.querySelectorAll(".wrong").forEach((label) => label.classList.remove("wrong"));
  enable(false);
  element("pause").textContent = "Pause";
  running = call === "start" ? JSON.stringify(chosen()) : "";
  ask(call, chosen(), ...(running === asked ? [await bytes(specimen)] : []));
}

async function bytes(file) { return new Uint8Array(await (await fetch(file)).arrayBuffer()); }

function listen(data) {
  if (data.ready) { enable(true); element("status").dataset.ready = data.ready; say("ready"); }
  if (data.status) say(data.status, data.done);
  if (data.panels) { [panels, made] = [data.panels, true]; runs = [...runs.filter((rows) => rows.length).slice(-3), []]; show_panels(data.note); }
  if (data.row) { runs.at(-1)[data.number] = data.row; enable(finished); schedule(); }
  if (data.snapshot) {
    element("viewer").contentWindow.postMessage({ common: data.common, snapshot: data.snapshot }, "*");
    element("rose").hidden = false;
    element("rose").querySelector("svg").innerHTML = drawn_rose(data.rose);
  }
  if (data.lack || data.error) {
    fail(data.lack ? LACK : data.error, data.fatal);
    fields().find((one) => one.name === data.field)?.closest("label").classList.add("wrong");
  }
  if (data.finished) { enable(true); if (running === asked && runs.at(-1)?.length && !data.error && !data.lack) compare(); element("status").dataset.runs = Number(element("status").dataset.runs ?? 0) + 1; }
  if (data.lack && data.fatal && element("status").dataset.ready) { say("loading Python again"); open_worker(); }
  if (data.opened) { opened = true; runs.push([]); enable(true); }
  if (data.answer !== undefined) save(data.call, data.answer);
}

function save(call, content) {
  const [ending, type] = { records: ["csv", "text/csv"], run_file: ["run.npz", ""], state_file: ["state.npz", ""] }[call];
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([content], { type })), download: `labkit.${ending}` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// --- the panels ------------------------------------------------------------------------------------------------------
function theory(at) { return site.theory.endsWith(".html") ? `${site.theory}#${at}` : site.theory; }

function show_panels(note) {
  document.querySelectorAll("article.plot").forEach((one) => one.remove());
  document.querySelector("main").insertAdjacentHTML("beforeend", panels.map((panel, k) => `<article class="plot" id="plot${k}"><h2>${escaped(panel.title)}</h2>`
    + `<p>${escaped(panel.sentence)} <a href="${theory(panel.theory)}">Theory</a></p><div></div><div class="legend">${panel.curves.length > 1 ? legend(panel) : ""}</div></article>`).join(""));
  if (note) element("summary").textContent = note;
}

let drawing = false;
function schedule() {  // at most once per frame
  if (drawing) return;
  drawing = true;
  requestAnimationFrame(() => {
    drawing = false;
    panels.forEach((panel, k) => { document.querySelector(`#plot${k} > div`).innerHTML = plot(panel, runs); });
  });
}

// --- start -----------------------------------------------------------------------------------------------------------
async function start() {
  site = await (await fetch("page.json")).json();
  for (const [group, rows] of Object.entries(site.groups)) element("specimen").insertAdjacentHTML("beforeend", rows.map((one) => field(group, one)).join(""));
  element("path").innerHTML = Object.entries(site.paths).map(([name, one]) => `<option value="${name}">${escaped(one.title)}</option>`).join("");
  element("exercises").innerHTML = site.exercises.map((one) => `<a data-name="${one.name}" href="?exercise=${one.name}">${escaped(one.title)}</a>`).join("");
  document.querySelectorAll("a.theory").forEach((link) => { link.href = theory(link.dataset.at); });
  document.body.addEventListener("click", (event) => {
    const link = event.target.closest('a[href^="?"]');
    if (!link) return;
    event.preventDefault();
    history.pushState(null, "", link.href);
    choose(location.search);
  });
  window.onpopstate = () => choose(location.search);
  choose(location.search);
  element("path").onchange = show_parameters;
  element("form").addEventListener("focusin", ({ target }) => { element("hint").textContent = target.closest("label")?.title ?? ""; });
  element("form").onsubmit = (event) => { event.preventDefault(); begin("start"); };
  element("go_on").onclick = () => begin("go_on");
  element("pause").onclick = ({ target }) => { ask(target.textContent === "Pause" ? "pause" : "resume"); target.textContent = target.textContent === "Pause" ? "Continue" : "Pause"; };
  element("end").onclick = () => { if (made) { ask("end"); enable(true); } else { say("loading Python again"); open_worker(); } };
  for (const call of ["records", "run_file", "state_file"]) element(call).onclick = () => ask(call);
  element("state").onchange = async ({ target }) => {
    const [file] = target.files;
    element("error").hidden = true;
    if (file?.size > site.upload.most) fail(site.upload.refusal);
    else if (file) ask("open_state", new Uint8Array(await file.arrayBuffer()));
    target.value = "";
  };
  window.onbeforeunload = (event) => { if (!finished) event.preventDefault(); };
  open_worker();
}
start().catch(() => fail("This page works only from a web server, such as that of the command labkit page.", true));
