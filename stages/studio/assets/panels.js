// The panel's lists and the dialogs. All text from files is set as text, never as markup.
import { ask } from "./server.js";

export const byId = (id) => document.getElementById(id);

export function element(tag, text, attributes = {}) {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  return made;
}

export function button(text, click, title = "") { return element("button", text, { click, title, type: "button" }); }

// The motion on the timeline and its results, each with radio buttons for A and B.
export function listResults(session, shown, act) {
  const rows = [session.state.motion, ...session.state.results].filter(Boolean).map((id, i) => {
    const item = element("li");
    for (const side of ["a", "b"]) {
      const label = element("label", "", { class: side });
      const radio = element("input", "", { type: "radio", name: side, value: id, "aria-label": `${side.toUpperCase()}: ${session.motions[id].name}`, change: () => act.choose(side, id) });
      radio.checked = shown[side] === id;
      label.append(radio, side.toUpperCase());
      item.append(label);
    }
    item.append(element("span", session.motions[id].name, { class: "name", title: session.motions[id].told.join("\n") }));
    if (i) item.append(button("go on", () => act.goOn(id), "Put it on the timeline"), button("×", () => act.discard(id), "Take it away"));
    return item;
  });
  byId("results").replaceChildren(...rows);
}

export function listConstraints(asked, act) {
  const rows = [
    ...["keep", "locks", "pins"].flatMap((field) => asked[field].map((each, i) => [field, i, `${{ keep: "keep", locks: "lock", pins: "pin" }[field]} ${each.part || each.end}: ${each.frames}`])),
    ...(asked.path ? [["path", 0, `pelvis on a path: ${asked.path.frames.length} frames`]] : []),
  ].map(([field, i, text]) => {
    const item = element("li");
    item.append(element("span", text, { class: "name", title: text }), button("×", () => act(field, i), "Remove"));
    return item;
  });
  byId("constraints").replaceChildren(...rows);
}

const VERBS = [
  ["trim", "Trim", "to the range", null], ["mirror", "Mirror", "left and right", null],
  ["smooth", "Smooth", "seconds", ["seconds", 0.3, 0.05, 10]], ["denoise", "Denoise", "strength", ["strength", 1, 0, 1]],
  ["loop", "Loop", "fills back to the start", null], ["join", "Join", "seconds, then", ["blend", 0.5, 0, 10], "other"],
  ["retarget", "Retarget", "to the rig of", null, "other"],
];

export function buildVerbs(act) {
  byId("verbs").replaceChildren(...VERBS.map(([verb, label, words, number, other]) => {
    const row = element("div"), field = number && element("input", "", { type: "number", value: number[1], min: number[2], max: number[3], step: 0.05, "aria-label": `${label}: ${number[0]}` });
    const select = other && element("select", "", { "data-other": verb, "aria-label": `${label}: second file` });
    row.append(button(label, () => act(verb, number ? { [number[0]]: Number(field.value) } : {}, select?.value)), element("span", words, { class: "note" }));
    if (field) row.append(field);
    if (select) row.append(select);
    return row;
  }));
}

export function fillSelect(select, values, names = values) {
  const before = select.value;
  select.replaceChildren(...values.map((value, i) => element("option", names[i], { value })));
  if (values.includes(before)) select.value = before;
}

// The clip that a person chooses of several; "" where the dialog is closed without one.
export function chooseClip(words, clips) {
  const dialog = byId("clip-dialog");
  byId("clip-words").textContent = words;
  return new Promise((resolve) => {
    let chosen = "";
    byId("clips").replaceChildren(...clips.map((clip) => {
      const item = element("li");
      item.append(button(clip, () => { chosen = clip; dialog.close(); }));
      return item;
    }));
    dialog.addEventListener("close", () => resolve(chosen), { once: true });
    dialog.showModal();
  });
}

export async function showFiles(open, resume) {
  const [files, recent] = await Promise.all([ask("files"), ask("sessions")]);
  const show = () => {
    const words = byId("search").value.toLowerCase();
    byId("files").replaceChildren(...files.filter((name) => name.toLowerCase().includes(words)).slice(0, 200).map((name) => {
      const item = element("li");
      item.append(button(name, () => open(name)));
      return item;
    }));
  };
  byId("search").oninput = show;
  show();
  byId("recent").replaceChildren(...recent.map((each) => {
    const item = element("li"), when = new Date(each.time * 1000).toLocaleString();
    item.append(button(`${each.name} · ${each.label} · ${when}`, () => resume(each.id)));
    return item;
  }));
  byId("open-dialog").showModal();
}
