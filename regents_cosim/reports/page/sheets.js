// --- Sheets: what is known of a case, in words and tables ---

function element(tag, properties = {}, ...children) {
  const { dataset, style, ...plain } = properties;
  const made = Object.assign(document.createElement(tag), plain);
  Object.assign(made.dataset, dataset);
  for (const [name, value] of Object.entries(style ?? {})) made.style.setProperty(name, value);
  made.append(...children);
  return made;
}

// Names may be broken after their signs, and where they have none for long.
function breakable(name) {
  return name.split(/(?<=[:._/-])|(?<=[^\s:._/-]{24})/).flatMap((part) => [part, element("wbr")]);
}

function byId(id) {
  return document.getElementById(id);
}

function fillSheets(content) {
  fillList("judgement", content.judgement);
  byId("judgement-sheet").hidden = !content.judgement.length;
  fillList("facts", content.facts);
  fillList("settings", Object.entries(content.settings).map(([name, value]) => [name.replaceAll("_", " "), String(value)]));
  byId("settings-fold").hidden = !Object.keys(content.settings).length;
  fillMotion(content.motion);
  fillCosts(content.costs);
  byId("commands").parentElement.hidden = !content.commands.length;
  byId("commands").replaceChildren(...content.commands.map((command) => commandBox(...command)));
}

function fillList(id, pairs) {
  byId(id).replaceChildren(...pairs.flatMap(([name, value]) => [element("dt", {}, termed(name)), element("dd", { textContent: value })]));
}

function fillMotion(rows) {
  byId("motion-sheet").hidden = !rows.length;
  const heads = ["5 … 95 %", "traffic", "before", "after"].map((textContent) => element("th", { textContent, scope: "col" }));
  const range = ([low, high]) => element("td", { textContent: `${signed(low)} … ${signed(high)}` });
  const lines = rows.map(({ quantity, unit, traffic, before, after }) =>
    element("tr", {}, element("td", {}, `${quantity} `, element("span", { className: "faint", textContent: unit })), ...[traffic, before, after].map(range)),
  );
  const beyond = rows.filter((row) => row.beyond_percent > 0).map((row) => `${row.quantity.toLowerCase()} ${row.beyond_percent} % of the time beyond ${row.limit} ${row.unit}`);
  byId("beyond").textContent = beyond.length ? `After the attack: ${beyond.join("; ")}.` : "After the attack within what a car on a dry road does.";
  byId("motion").replaceChildren(element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...lines));
}

function fillCosts({ iterations, terms }) {
  const names = Object.keys(terms);
  byId("cost-sheet").hidden = !names.length;
  const lines = names.map((name) => {
    const values = terms[name];
    const span = `${values[0].toPrecision(3)} → ${values.at(-1).toPrecision(3)}`;
    return element("div", { className: "cost" }, element("span", { textContent: name.replaceAll("_", " ") }),
      element("canvas", { role: "img", ariaLabel: `cost ${name} over the iterations` }), element("span", { textContent: span }));
  });
  const until = element("p", { className: "faint", textContent: `first to last of ${(iterations.at(-1) ?? 0) + 1} iterations` });
  byId("costs").replaceChildren(...lines, until);
  drawCosts(terms);
}

function drawCosts(terms) {
  document.querySelectorAll("#costs canvas").forEach((canvas, k) => sparkline(canvas, Object.values(terms)[k], colours.ink));
}

function commandBox(what, line) {
  const button = element("button", { type: "button", className: "quiet", textContent: "Copy" });
  button.addEventListener("click", () => copy(line, button));
  return element("div", { className: "command" }, element("p", {}, what, button), element("pre", { textContent: line }));
}

async function copy(text, button) {
  const before = button.textContent;
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = "Copied";
  } catch {
    button.textContent = "Not allowed here"; // browsers may refuse it to files
  }
  setTimeout(() => (button.textContent = before), 1500);
}
