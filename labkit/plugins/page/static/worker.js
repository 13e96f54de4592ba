"use strict";
// Runs labkit in a thread of its own, so that the page stays alive: {open} loads it, {call, given} calls the bench.
let python, bench;

async function bytes(file) {
  const answer = await fetch(file);
  if (!answer.ok) throw new Error(`${file} is not there (${answer.status})`);
  return new Uint8Array(await answer.arrayBuffer());
}

async function open({ pyodide, wheel }) {
  if (!wheel) throw new Error("This page was written without labkit for browsers: the command labkit page -o FOLDER writes all of it.");
  importScripts(pyodide + "pyodide.js");
  const labkit = bytes(wheel);
  python = await loadPyodide({ indexURL: pyodide });
  await python.loadPackage("numpy", { messageCallback: () => {} });
  python.unpackArchive(await labkit, "wheel");
  bench = python.pyimport("labkit.plugins.page.bench").Bench((text) => postMessage(JSON.parse(text)));
  return { ready: python.version };
}

onmessage = async ({ data: { call, given = [] } }) => {
  try {
    if (call === "open") return postMessage(await open(...given));
    const answer = await bench[call](...given.map((one) => python.toPy(one)));
    if (answer !== undefined) postMessage({ answer: answer.toJs ? answer.toJs() : answer, call });
  } catch (error) {  // the last line of a Python traceback says what happened
    const text = String(error.message || error).trim().split("\n").at(-1), fatal = !bench || Boolean(error.pyodide_fatal_error);
    postMessage({ error: text, lack: /memory/i.test(text) || Boolean(bench && fatal), finished: Boolean(bench), fatal });
  }
};
