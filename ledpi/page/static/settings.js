// Every key of the configuration: what it means, its value, where that is from, and, where the server offers it, its change.

import { $, LoginNeeded, ask, login } from "./server.js";
import { html } from "./drawing.js";
import { download } from "./actions.js";

let told = { keys: [], edit: null };

async function list() {
  try {
    told = await (await ask("api/config")).json();
  } catch (error) {
    $("config-says").textContent = `It cannot be shown: ${error.message}`;
    return;
  }
  const { keys, edit, says } = told;
  $("config-says").textContent = edit
    ? `The values in ${edit.file}. A change is saved there; the daemon runs with it from its next reload on${says && `; ${says}`}.`
    : `${says || "The values that the daemon runs with."} \`ledpi config set\` changes them. ${told.why_not}.`;
  $("editing").hidden = !edit;
  if (edit) {
    $("mistakes").replaceChildren(...edit.mistakes.map((mistake) => html("li", "", mistake)));
    $("undo").disabled = !edit.undo;
    $("reload").classList.toggle("on", keys.some((row) => row.waits));
  }
  const sections = [...new Set(keys.map(({ key }) => key.split(".")[0]))];
  $("keys").replaceChildren(...sections.flatMap((section) => {
    const rows = keys.filter(({ key }) => key.split(".")[0] === section);
    return [html("h3", "", section), html("ul", "", ...rows.map(rowOf))];
  }));
}

function rowOf(row) {
  const name = html("code", "", ...row.key.split(/(?<=[._])/).flatMap((part) => [part, html("wbr")])); // where a phone may break it
  const value = html("span", "value", row.text), line = html("li", "", name, value, html("span", "from quiet", row.from));
  const range = [row.allowed && `Allowed: ${row.allowed}.`, row.unit && `In ${row.unit}.`, `Default: ${row.default}.`];
  line.append(html("p", "means quiet", [row.meaning && `${row.meaning}.`, ...range].filter(Boolean).join(" ")));
  if (row.waits) line.append(html("p", "waits", "The daemon still runs with another value: reload it."));
  line.dataset.key = row.key;
  if (told.edit && row.from !== "--set") {
    const change = html("button", "link", "Change");
    change.type = "button";
    change.setAttribute("aria-label", `Change ${row.key}`);
    change.addEventListener("click", () => change.replaceWith(formOf(row)));
    line.append(change);
  }
  return line;
}

function formOf(row) {
  const form = html("form", "inline"), input = html("input"), save = html("button", "", "Save"), cancel = html("button", "", "Cancel");
  const wrong = html("p", "wrong");
  input.type = row.secret ? "password" : "text";
  input.value = row.secret || row.text === "none" ? "" : row.text;
  input.autocomplete = "off";
  input.spellcheck = false;
  input.setAttribute("aria-label", `New value of ${row.key}`);
  wrong.setAttribute("role", "alert");
  cancel.type = "button";
  cancel.addEventListener("click", () => back(row.key));
  form.append(input, save, cancel, wrong);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    save.disabled = true;
    const error = await doing(`Saving ${row.key}…`, () => edit({ do: "set", key: row.key, value: input.value }));
    save.disabled = false;
    wrong.textContent = error;
    if (error) $("edited").textContent = ""; // it is said here
    else back(row.key);
  });
  setTimeout(() => input.focus());
  return form;
}

async function back(key) { // with the keyboard where it was
  await list();
  $("keys").querySelector(`[data-key="${key}"] button`)?.focus();
}

const edit = (request) => ask("api/edit", "POST", undefined, JSON.stringify(request));

// Says what is done, and what came of it; returns what is wrong.
async function doing(what, act) {
  $("edited").textContent = what;
  try {
    $("edited").textContent = `Done: ${(await (await act()).json()).says || "the daemon runs with the file as it is now"}.`;
    return "";
  } catch (error) {
    if (error instanceof LoginNeeded) login();
    $("edited").textContent = error instanceof LoginNeeded ? "The token is wrong." : `Not done: ${error.message}`;
    return $("edited").textContent;
  }
}

$("config").addEventListener("toggle", () => $("config").open && list());
$("reload").addEventListener("click", () => doing("Reloading…", () => ask("api/reload", "POST")).then(list));
$("undo").addEventListener("click", () => {
  const { to, changes } = told.edit.undo;
  if (confirm(`Bring back the file as it was before the last change?\n\n${changes.join("\n") || "Only comments are other."}`)) {
    doing("Undoing…", () => edit({ do: "undo", to })).then(list);
  }
});
$("backup").addEventListener("click", () => download("api/backup", `ledpi-${new Date().toISOString().slice(0, 10)}.ledpi`, 15000, $("edited")));
$("put-back").addEventListener("click", () => $("archive").click());
$("archive").addEventListener("change", () => {
  const [file] = $("archive").files;
  $("archive").value = "";
  if (!file || !confirm(`Put back configuration, lens and map from ${file.name}? The older files are kept.`)) return;
  if (file.size > told.edit.most_bytes) $("edited").textContent = `Not done: ${file.name} is too large to be a backup`;
  else doing("Putting back…", () => ask("api/restore", "POST", undefined, file)).then(list);
});
