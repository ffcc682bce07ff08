// The live page. It asks for the next picture once it has drawn the last, and for the state as soon as that has changed.

import { $, again, ask, isLoggingIn, notice, pause, silentFor } from "./server.js";
import { tellButtons } from "./actions.js";
import { loadHistory, tellHealth } from "./health.js";
import { nextBoard } from "./lens.js";
import { forgetBest } from "./light.js";
import { drawMap } from "./map.js";
import "./settings.js";
import "./takes.js";
import { nextPicture, tellKey } from "./picture.js";
import { serverIsGone, tellLink, tellPanels } from "./table.js";

const SILENT_MS = 5000; // after which `ledpi view` is taken to have ended

let version = -1;
async function nextState() {
  const state = await (await ask(`api/state?after=${version}`)).json();
  version = state.version;
  if (tellLink(state)) {
    forgetBest();
    loadHistory();
  }
  if (state.daemon) tellKey(state.daemon.panels);
  tellPanels(state.panels);
  tellHealth(state);
  drawMap(state);
  tellButtons(state);
  await pause(200); // five times a second is enough to read
}

setInterval(() => {
  if (silentFor() < SILENT_MS || document.hidden || isLoggingIn()) return;
  notice("ledpi view does not answer; retrying.");
  $("state").textContent = "no answer";
  $("state").className = "pill down";
  serverIsGone();
}, 1000);
loadHistory().then(() => {
  again(nextState);
  again(nextPicture);
  again(nextBoard);
});
