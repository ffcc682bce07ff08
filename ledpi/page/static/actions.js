// The buttons.

import { $, LoginNeeded, ask, login } from "./server.js";
import { html } from "./drawing.js";
import { forgetBest } from "./light.js";
import { choose, shownFrame } from "./picture.js";

const MOST_TOLD = 3; // actions

let recording = false;
export function tellButtons(state) {
  recording = state.recording;
  const up = state.link.state === "up", may = (state.daemon && state.daemon.may) || [];
  const kept_s = state.health ? state.health.kept_s : null;
  let reason = "";
  if (!up) reason = "Saving and recording need a running daemon.";
  else if (!may.length) reason = "The daemon permits this page no saving: ledpi view must run as the daemon's user, as root, or in group ledpi.";
  $("save").disabled = !!reason || !may.includes("save");
  $("record").disabled = !!reason || !may.includes("record");
  if (!reason && !may.includes("save")) reason = "There are no last seconds to save: rewind.seconds is 0.";
  $("why-greyed").textContent = reason;
  $("keep").disabled = !shownFrame();
  $("save").textContent = kept_s >= 1 ? `Save the last ${Math.floor(kept_s)} s` : "Save the last seconds";
  $("record").textContent = recording ? "Stop the recording" : "Start a recording";
  $("record").classList.toggle("on", recording);
}

// Each action has a line of its own: one may take a minute, and another is done meanwhile.
function tellOf(doing) {
  const line = html("p", "", doing);
  $("done").append(line);
  while ($("done").children.length > MOST_TOLD) $("done").firstChild.remove();
  return line;
}

export async function change(path, doing, done) {
  const line = tellOf(doing);
  try {
    line.textContent = done(await (await ask(path, "POST")).json());
  } catch (error) {
    if (error instanceof LoginNeeded) login();
    line.textContent = error instanceof LoginNeeded ? "The token is wrong." : `Not done: ${error.message}`;
  }
  return line;
}

export async function download(path, name, within_ms, line = tellOf("Fetching…")) {
  const link = document.createElement("a");
  try {
    link.href = URL.createObjectURL(await (await ask(path, "GET", within_ms)).blob());
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    line.textContent = `Saved by this browser as ${name}.`;
  } catch (error) {
    line.textContent = `Not done: ${error.message}`;
  }
}

$("save").addEventListener("click", () => change("api/save", "Saving the last seconds…", (told) => `Saved on the daemon's machine: ${told.path}`));
let recordingSays = null; // the line that says how it ends
$("record").addEventListener("click", async () => {
  if (recording) {
    recordingSays?.remove();
    await change("api/record_stop", "Ending the recording…", (told) => `Recorded on the daemon's machine${told.path ? `: ${told.path}` : ""}`);
  } else recordingSays = await change("api/record", "Starting…", () => "Recording. It stops when you click Stop, or after ten minutes.");
});
$("keep").addEventListener("click", () => download("api/frame.png", `ledpi-frame-${shownFrame().seq}.png`));
$("forget").addEventListener("click", forgetBest);
$("ask-why").addEventListener("click", () => choose("whynot"));
