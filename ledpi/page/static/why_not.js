// Why panels are not read: a list beside the numbers in the picture, and what the whole picture lacks.

import { $ } from "./server.js";
import { html, keepList, setText } from "./drawing.js";
import { isNumbered } from "./picture.js";

export function tellWhyNot(frame) {
  $("whynot").hidden = frame.kind !== "whynot";
  if (frame.kind !== "whynot") return;
  const told = frame.why_not.filter(isNumbered);
  keepList($("notes"), frame.notes, () => html("li"), (item, note) => setText(item, sentences(note)));
  keepList($("reasons"), told, makeReason, tellReason);
  $("no-reasons").hidden = told.length > 0;
  tellShapes(frame);
}

const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
const sentences = ({ says, helps }) => `${capital(says)}.${helps ? ` What helps: ${helps}.` : ""}`;

function makeReason(index) {
  const item = html("li", "", html("b", "", String(index + 1)), html("span", "", html("span", "says"), html("span", "helps"), html("code")));
  item.tabIndex = 0;
  const mark = (on) => $("overlay").querySelectorAll(".dropped:not(.shape)")[index]?.classList.toggle("told", on);
  for (const event of ["focus", "mouseenter"]) item.addEventListener(event, () => mark(true));
  for (const event of ["blur", "mouseleave"]) item.addEventListener(event, () => mark(false));
  return item;
}

function tellReason(item, found) {
  item.dataset.why = found.why;
  setText(item.querySelector(".says"), `${found.kind === "panel" ? capital(found.says) : `If it is a panel: ${found.says}`}. `);
  setText(item.querySelector(".helps"), found.helps ? `What helps: ${found.helps}. ` : "");
  setText(item.querySelector("code"), found.why);
}

// Outlines on walls and the like, which are no panels: how many of which reason, for those who know the reasons.
function tellShapes(frame) {
  const counts = Object.entries(frame.rejected).sort((a, b) => b[1] - a[1]);
  $("shapes").hidden = !counts.length;
  const all = counts.reduce((sum, [, count]) => sum + count, 0);
  setText($("shapes-says"), `All that was dropped in this frame, by reason (${all}); most of it is no panel`);
  keepList($("shape-counts"), counts, () => html("li", "", html("code"), " ", html("span")), (item, [key, count]) => {
    setText(item.querySelector("code"), key);
    setText(item.querySelector("span"), `× ${count}`);
  });
}
