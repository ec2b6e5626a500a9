// Elements without a framework and without inline styles (the page's policy forbids those).

/** Make an element. `props`: attributes; `class`, `text`, `on` (listeners) and `data` are special; null leaves out. */
export function el(tag, props = {}, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(props)) {
    if (value === null || value === undefined || value === false) continue;
    if (key === "class") node.className = value;
    else if (key === "text") node.textContent = value;
    else if (key === "data") Object.assign(node.dataset, value);
    else if (key === "on") for (const [name, fn] of Object.entries(value)) node.addEventListener(name, fn);
    else node.setAttribute(key, value === true ? "" : String(value));
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return node;
}

/** Change text only where it differs, so that selections and screen readers are left in peace. */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Replace the children only when `key` differs from the last one: focus and hover survive an unchanged list. */
export function renderKeyed(node, key, build) {
  if (node.dataset.key === key) return false;
  const focused = node.contains(document.activeElement) ? document.activeElement.id : "";
  node.dataset.key = key;
  node.replaceChildren(...[build()].flat().filter(Boolean));
  if (focused) document.getElementById(focused)?.focus();
  return true;
}

/** A state as a dot and a word: never by colour alone. */
export function chip(tone, word, title = null) {
  return el("span", { class: "chip", data: { tone }, title }, el("span", { class: "dot", data: { tone } }), word);
}

/** What is known for a field, unless something stands there or is being typed there: it may come late. */
export function offer(control, text) {
  if (!control.value && document.activeElement !== control) control.value = text;
}
