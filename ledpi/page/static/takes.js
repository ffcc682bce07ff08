// What the daemon has recorded: listed, downloaded, deleted.

import { $, ask } from "./server.js";
import { cells, html } from "./drawing.js";
import { change, download } from "./actions.js";

const LONGEST_MS = 3600000; // of a download: ten minutes of pictures over a slow network

const CAUSES = { asked: "last seconds", recorded: "recording", camera_lost: "camera lost", contradicted: "map contradicted" };

// 20261124T101502Z-camera_lost-2.part
function told({ name, frames, written }) {
  const [, y, mo, d, h, mi, s, cause, part] = /^(....)(..)(..)T(..)(..)(..)Z-([a-z_]+).*?(\.part)?$/.exec(name);
  const when = new Date(Date.UTC(y, mo - 1, d, h, mi, s)).toLocaleString();
  return [when, CAUSES[cause] || cause, String(frames), written ? "being written" : part ? "incomplete" : "complete"];
}

function button(text, label, act, off) {
  const made = html("button", "link", text);
  made.type = "button";
  made.disabled = off;
  made.setAttribute("aria-label", label);
  made.addEventListener("click", act);
  return made;
}

async function list() {
  let takes = [];
  try {
    takes = await (await ask("api/takes")).json();
    $("takes-says").textContent = takes.length ? "On the daemon's machine. A download is one tar file." : "None yet.";
  } catch (error) {
    $("takes-says").textContent = `They cannot be listed: ${error.message}`;
  }
  $("takes-rows").replaceChildren(...takes.map((take) => {
    const row = document.createElement("tr"), may = html("td", "", ""), name = encodeURIComponent(take.name);
    row.title = take.name;
    cells(row, told(take));
    may.append(
      button("Download", `Download ${take.name}`, () => download(`api/take.tar?name=${name}`, `${take.name}.tar`, LONGEST_MS), take.written),
      button("Delete", `Delete ${take.name}`, async () => {
        if (!confirm(`Delete ${take.name} for good?`)) return;
        await change(`api/take_delete?name=${name}`, "Deleting…", () => `Deleted ${take.name}.`);
        list();
      }, take.written),
    );
    row.append(may);
    return row;
  }));
}

$("takes").addEventListener("toggle", () => $("takes").open && list());
$("takes-again").addEventListener("click", list);
