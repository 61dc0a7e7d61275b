// --- Table: the cases, what to fix first; sorted by a column, filtered by what they have in common ---

const CHANGES = ["broken", "worse", "unchanged", "better", "fixed"];
const LEAST_TABLE_PX = 928;
const AT_ONCE = 200; // lines that are laid out; more when they are asked for

class CaseTable {
  constructor({ drivers, driven, rows }) {
    Object.assign(this, { drivers, driven, rows, filters: {}, sorted: null, search: "", lines: [], most: AT_ONCE });
    rows.forEach((row, index) => (row.index = index));
    this.columns = this.chooseColumns();
    this.addHeads();
    this.addFilters();
    addEventListener("resize", () => this.fit());
    byId("more").addEventListener("click", () => this.layOut(this.most + AT_ONCE));
    this.refresh();
  }

  get shown() {
    const wanted = Object.entries(this.filters).filter(([, value]) => value !== "");
    const kept = this.rows.filter((row) => row.id.toLowerCase().includes(this.search)
      && wanted.every(([name, value]) => FILTERS[name].of(row, this.drivers).includes(value)));
    if (!this.sorted) return kept;
    const { column: { value }, down } = this.sorted;
    // Empty cells stay at the end, whichever way.
    const order = (a, b) => {
      const [x, y] = [value(a), value(b)];
      if (x === null || y === null) return (x === null) - (y === null);
      return (down ? -1 : 1) * (typeof x === "number" ? x - y : String(x).localeCompare(String(y), undefined, { numeric: true }));
    };
    return kept.sort((a, b) => order(a, b) || a.index - b.index);
  }

  chooseColumns() {
    const told = this.rows.some((row) => row.telling !== null);
    const blamed = this.rows.some((row) => row.fault !== null);
    const prevented = this.rows.some((row) => row.prevention !== null);
    const planners = new Set(this.rows.map((row) => row.attacked)).size > 1;
    const compared = this.drivers.length > 1;
    return [
      compared && { name: "Change", value: (row) => CHANGES.indexOf(row.change), cell: (row) => [element("span", { className: `tag ${row.change}`, textContent: row.change })] },
      { name: "Case", style: "case", value: (row) => row.id, cell: (row) => [element("a", { href: hashOf({ case: row.id }) }, ...breakable(row.id))] },
      { name: "Network", style: "spare", value: (row) => row.network },
      planners && { name: this.driven ? "Attacked" : "Planner", labelled: true, value: (row) => row.attacked || null, cell: (row) => breakable(row.attacked) },
      ...this.drivers.map((driver, k) => ({ name: this.driven ? driver : "Result", style: "by", labelled: compared, value: (row) => endingOf(row, k), cell: (row) => [ending(row, k)] })),
      { name: "At", unit: " s", style: "number", value: (row) => least(row.endings.map((hit) => hit && hit.step * row.dt)), digits: 1 },
      { name: "Impact", unit: " km/h", style: "number", value: (row) => greatest(row.endings.map((hit) => hit && 3.6 * hit.impact)), digits: 0 },
      !compared && { name: "Least TTC", unit: " s", style: "number spare", value: (row) => (row.endings[0] ? null : (row.closest[0]?.ttc_s ?? null)), digits: 1 },
      told && { name: "Telling", style: "word", labelled: true, value: (row) => tellingOf(row), cell: (row) => [element("span", { className: row.telling ? "yes" : "", textContent: tellingOf(row) })] },
      told && { name: "Flawless", style: "word", labelled: true, value: (row) => flawlessOf(row), cell: (row) => [element("span", { className: row.flawless ? "yes" : "", textContent: flawlessOf(row) })] },
      blamed && { name: "At fault", style: "word", labelled: true, value: (row) => row.fault, cell: (row) => [element("span", { className: FAULT_LOOK[row.fault] ?? "", textContent: row.fault })] },
      prevented && { name: "Preventable", style: "word", labelled: true, value: (row) => row.prevention && PREVENTIONS[row.prevention] },
    ].filter(Boolean);
  }

  // The line of a row, made when it is first laid out.
  line(row) {
    return (this.lines[row.index] ??= this.newLine(row));
  }

  // The line of a row that is to be seen.
  reveal(row) {
    const at = this.shown.indexOf(row);
    if (at >= this.most) this.layOut(at + AT_ONCE);
    return this.line(row);
  }

  newLine(row) {
    const cells = this.columns.map((column) => {
      const value = column.value(row);
      const blank = value === null || value === "";
      const words = blank ? "–" : typeof value === "number" && column.digits !== undefined ? value.toFixed(column.digits) + column.unit : value;
      const dataset = (column.labelled ?? !column.cell) ? { label: column.name } : {};
      return element("td", { className: `${column.style ?? ""} ${blank ? "blank" : ""}`, dataset }, ...(column.cell && !blank ? column.cell(row) : [words]));
    });
    const line = element("tr", {}, ...cells);
    line.addEventListener("click", (event) => {
      if (!event.target.closest("a") && !String(getSelection())) location.hash = hashOf({ case: row.id });
    });
    return line;
  }

  addHeads() {
    const head = document.querySelector("#cases thead tr");
    for (const column of this.columns) {
      const meaning = page.terms[column.name.toLowerCase()];
      const button = element("button", { type: "button", dataset: meaning ? { tip: meaning } : {} }, ...breakable(column.name));
      button.addEventListener("click", () => this.sort(column));
      column.head = element("th", { scope: "col", className: column.style ?? "" }, button);
      head.append(column.head);
      byId("sort").append(element("option", { value: column.name, textContent: `Sorted by ${column.name.toLowerCase()}` }));
    }
    byId("sort").addEventListener("input", ({ target }) => {
      const column = this.columns.find(({ name }) => name === target.value);
      this.sorted = column ? { column, down: falls(column) } : null;
      this.refresh();
    });
  }

  // First as is natural, then the other way, then what to fix first again.
  sort(column) {
    const down = falls(column);
    if (this.sorted?.column !== column) this.sorted = { column, down };
    else this.sorted = this.sorted.down === down ? { column, down: !down } : null;
    this.refresh();
  }

  addFilters() {
    for (const [name, { title, of }] of Object.entries(FILTERS)) {
      const values = [...new Set(this.rows.flatMap((row) => of(row, this.drivers)))].sort();
      this.filters[name] = "";
      if (values.length < 2 || !title) continue; // without a title: by buttons alone
      const options = values.map((value) => element("option", { value, textContent: value }));
      const select = element("select", { id: `filter-${name}`, ariaLabel: title }, element("option", { value: "", textContent: title }), ...options);
      select.addEventListener("input", () => this.filter(name, select.value));
      byId("filters").insertBefore(select, byId("sort"));
    }
    byId("search").addEventListener("input", (event) => {
      this.search = event.target.value.trim().toLowerCase();
      this.refresh();
    });
    for (const button of document.querySelectorAll("[data-filter]")) {
      const { filter, value } = button.dataset;
      button.addEventListener("click", () => this.filter(filter, this.filters[filter] === value ? "" : value));
    }
    byId("all").addEventListener("click", () => this.clear());
  }

  filter(name, value) {
    this.filters[name] = value;
    this.refresh();
  }

  clear() {
    Object.keys(this.filters).forEach((name) => (this.filters[name] = ""));
    this.search = byId("search").value = "";
    this.refresh();
  }

  layOut(most, shown = this.shown) {
    this.most = most;
    document.querySelector("#cases tbody").replaceChildren(...shown.slice(0, most).map((row) => this.line(row)));
    byId("more").hidden = shown.length <= most;
    byId("more").textContent = `Show ${Math.min(AT_ONCE, shown.length - most)} more of ${shown.length - most}`;
    this.fit();
  }

  // A table where there is room for it, else a card for each case.
  fit() {
    const table = byId("cases");
    table.classList.remove("cards");
    table.classList.toggle("cards", innerWidth < LEAST_TABLE_PX || table.offsetWidth > table.parentElement.clientWidth);
  }

  refresh() {
    const shown = this.shown;
    this.layOut(AT_ONCE, shown);
    byId("count").textContent = shown.length === this.rows.length ? `${shown.length}, what to fix first` : `${shown.length} of ${this.rows.length}`;
    if (this.sorted && shown.length === this.rows.length) byId("count").textContent = `${shown.length}`;
    byId("nothing").hidden = shown.length > 0;
    byId("cases").hidden = shown.length === 0;
    for (const column of this.columns) {
      const how = this.sorted?.column !== column ? "none" : this.sorted.down ? "descending" : "ascending";
      column.head.setAttribute("aria-sort", how);
    }
    byId("sort").value = this.sorted?.column.name ?? "";
    for (const [name, value] of Object.entries(this.filters)) {
      if (byId(`filter-${name}`)) byId(`filter-${name}`).value = value;
    }
    for (const button of document.querySelectorAll("[data-filter]")) {
      button.ariaPressed = String(this.filters[button.dataset.filter] === button.dataset.value);
    }
  }
}

// What cases can be filtered by: the values that a row has.
const FILTERS = {
  change: { of: (row) => (row.change ? [row.change] : []) },
  need: { of: (row) => (row.need === null ? [] : [row.need]) },
  group: { of: (row) => (row.group === null ? [] : [String(row.group)]) },
  network: { title: "Any network", of: (row) => [row.network] },
  tag: { title: "Any scenario", of: (row) => row.tags },
  collision_type: { title: "Any collision", of: (row, drivers) => [...new Set(drivers.map((_, k) => endingOf(row, k)))] },
  fault: { title: "Any fault", of: (row) => [row.fault ? FAULT_WORDS[row.fault] : "not judged"] },
  telling: { title: "Telling or not", of: (row) => [tellingOf(row) === null ? "no crash" : row.telling === null ? "not known whether telling" : row.telling ? "telling" : "not telling"] },
  prevention: { title: "Preventable or not", of: (row) => [row.prevention === null ? "not judged" : PREVENTIONS[row.prevention]] },
  planner: { title: "Any planner", of: (row, drivers) => (drivers.length > 1 ? drivers.filter((_, k) => row.endings[k]).map((name) => `${name} crashes`) : [row.attacked || "none"]) },
};
const PREVENTIONS = { preventable: "preventable", by_swerving: "preventable by swerving", not_preventable: "not preventable", unknown: "not known" };
const FAULT_WORDS = { planner: "planner at fault", both: "both at fault", adversary: "adversary at fault", unclear: "fault unclear" };
const FAULT_LOOK = { planner: "blamed", both: "blamed" };

// Numbers begin with the greatest, but for a time to collision, which is worse the less it is.
function falls(column) {
  return (column.style ?? "").includes("number") && column.name !== "Least TTC";
}

// Whether the crash tells something about the planner; null where there is none.
const tellingOf = (row) => known(row, row.telling);
const flawlessOf = (row) => known(row, row.flawless);

function known(row, holds) {
  if (!row.endings.some(Boolean) || row.clean === null) return null;
  return holds === null ? "not known" : holds ? "yes" : "no";
}

function endingOf(row, k) {
  return row.errors[k] ? "Planner failed" : (row.endings[k]?.collision_type ?? (page.driven ? "No collision" : row.otherwise));
}

function ending(row, k) {
  const look = row.errors[k] ? "failed" : row.endings[k] ? "crash" : "";
  return element("span", { className: `result ${look}`, textContent: endingOf(row, k) });
}

function least(values) {
  const found = values.filter((value) => value !== null);
  return found.length ? Math.min(...found) : null;
}

function greatest(values) {
  const found = values.filter((value) => value !== null);
  return found.length ? Math.max(...found) : null;
}

function hashOf(parts) {
  return `#${new URLSearchParams(parts)}`;
}
