// Elements and canvases, as all parts of the page make them.


const SVG = "http://www.w3.org/2000/svg";

export function element(parent, name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  parent.append(made);
  return made;
}

export const pointsOf = (corners) => corners.map((corner) => corner.join(",")).join(" ");

export function boxOf(corners) {
  const xs = corners.map((c) => c[0]), ys = corners.map((c) => c[1]);
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}

export function html(name, cls, ...content) {
  const made = document.createElement(name);
  if (cls) made.className = cls;
  made.append(...content);
  return made;
}

export function setText(node, text) { // who reads it is not disturbed
  if (node.textContent !== text) node.textContent = text;
}

// As many children as there are items, each made once and then told anew: who is there with the keyboard stays.
export function keepList(parent, items, make, tell) {
  while (parent.children.length > items.length) parent.lastChild.remove();
  items.forEach((item, index) => tell(parent.children[index] || parent.appendChild(make(index)), item, index));
}

export function cells(row, texts) {
  texts.forEach((text, index) => setText(row.cells[index] || row.insertCell(), text));
}

export function canvasOf(canvas) {
  const scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale].map(Math.round);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, width, height);
  return { context, width, height, scale };
}

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
export const number = (value, digits) => value.toFixed(digits).replace("-", "−");
