// The catalogue as a table: sorted, filtered, linked both ways with the diagram; and the transitions.

/** @typedef {{name: string, title: string, of: (entry: Entry) => string | number | null, prose?: boolean}} Column */

const apart = [...new Set(page.members.flatMap((member) => Object.keys(member.fixed)))];

/** @type {Column[]} */
const COLUMNS = [
  { name: "id", title: "event", of: (entry) => entry.id },
  { name: "label", title: "label", of: (entry) => entry.label },
  { name: "branch", title: "branch", of: (entry) => entry.branch },
  { name: "orbit", title: "orbit", of: (entry) => entry.notation },
  ...[...page.varying, ...apart].map((name) => ({
    name,
    title: withUnit(name),
    of: (/** @type {Entry} */ entry) => entry.parameters[name] ?? null,
  })),
  { name: "error", title: "error", of: (entry) => entry.error },
  {
    name: "ghost",
    title: "status",
    of: (entry) => (entry.ghost ? "ghost" : "real"),
  },
  {
    name: "why",
    title: "why",
    of: (entry) => entry.why ?? entry.reason ?? entry.criticality ?? "",
    prose: true,
  },
];

/** The entries that pass the filter. */
function filtered() {
  const words = state.filter.toLowerCase().split(/\s+/).filter(Boolean);
  return page.entries.filter((entry) => {
    const family = familyById.get(entry.branch);
    if (state.scope === "here" && family && memberOf(family) !== state.member) return false;
    if (state.ghosts !== "all" && entry.ghost !== (state.ghosts === "ghost")) return false;
    const text = [
      entry.id,
      entry.label,
      entry.kind,
      entry.branch,
      entry.notation,
      entry.word,
      entry.why ?? "",
      entry.reason ?? "",
    ]
      .join(" ")
      .toLowerCase();
    return words.every((word) => text.includes(word));
  });
}

/** The same in the order asked for. */
function inOrder() {
  const down = state.sort.startsWith("-"),
    column = COLUMNS.find(({ name }) => name === state.sort.replace("-", ""));
  const rows = filtered();
  if (!column) return rows;
  rows.sort((a, b) => compared(column.of(a), column.of(b)));
  return down ? rows.reverse() : rows;
}

/** @param {string | number | null} a @param {string | number | null} b */
function compared(a, b) {
  if (typeof a === "number" && typeof b === "number") return a - b;
  return String(a ?? "").localeCompare(String(b ?? ""), "en", {
    numeric: true,
  });
}

/** Draw the table's head; a click sorts, a second one the other way. */
function drawHead() {
  d3.select("#table thead")
    .selectAll("tr")
    .data([0])
    .join("tr")
    .selectAll("th")
    .data(COLUMNS)
    .join("th")
    .attr("scope", "col")
    .attr("aria-sort", ({ name }) =>
      state.sort === name ? "ascending" : state.sort === `-${name}` ? "descending" : null,
    )
    .selectAll("button")
    .data((column) => [column])
    .join("button")
    .attr("type", "button")
    .text(
      ({ name, title }) =>
        title + (state.sort === name ? " \u25b2" : state.sort === `-${name}` ? " \u25bc" : ""),
    )
    .on("click", (_, { name }) => change({ sort: state.sort === name ? `-${name}` : name }));
}

/** Draw head, rows and count. */
function drawTable() {
  drawHead();
  const entries = inOrder();
  const rows = d3
    .select("#table tbody")
    .selectAll("tr")
    .data(entries, (/** @type {any} */ entry) => entry.id)
    .join("tr")
    .order()
    .attr("data-entry", ({ id }) => id)
    .on("click", (_, { id }) => choose(id));
  rows
    .selectAll("td")
    .data((entry) => COLUMNS.map((column) => ({ entry, column, value: column.of(entry) })))
    .join("td")
    .attr("class", ({ column, value }) =>
      column.prose ? "prose" : typeof value === "number" ? "number" : null,
    )
    .each(function ({ entry, column, value }) {
      const cell = /** @type {HTMLElement} */ (this);
      if (column.name === "id") cell.replaceChildren(chooser(entry.id));
      else
        cell.textContent =
          typeof value === "number" ? shown(value, column.name === "error" ? 2 : 12) : (value ?? "-");
    });
  element("count").textContent = `${entries.length} of ${page.entries.length}`;
  markRow(false);
}

/** A button that chooses an event. @param {string} id */
function chooser(id) {
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = id;
  button.addEventListener("click", (event) => {
    event.stopPropagation();
    choose(id);
  });
  return button;
}

/** Mark the chosen event's row, and bring it into sight within its table. @param {boolean} scroll */
function markRow(scroll) {
  for (const row of document.querySelectorAll("#table tbody tr")) {
    const own = row.getAttribute("data-entry") === state.at;
    if (own) row.setAttribute("aria-current", "true");
    else row.removeAttribute("aria-current");
    const frame = /** @type {HTMLElement} */ (row.closest(".scroll"));
    if (own && scroll) frame.scrollTop = /** @type {HTMLElement} */ (row).offsetTop - frame.clientHeight / 2;
  }
}

/** The transitions that were read; names of events in them choose these. */
function drawTransitions() {
  const list = element("transitions");
  element("reading").hidden = page.reading.transitions.length === 0;
  for (const { sentence } of page.reading.transitions) {
    const item = document.createElement("li");
    for (const part of sentence.split(/\b(e\d+)\b/)) item.append(entryById.has(part) ? chooser(part) : part);
    list.append(item);
  }
}

element("filter").addEventListener("input", (event) =>
  change({ filter: /** @type {HTMLInputElement} */ (event.target).value }),
);
element("scope").addEventListener("change", (event) =>
  change({ scope: /** @type {HTMLSelectElement} */ (event.target).value }),
);
element("ghosts").addEventListener("change", (event) =>
  change({ ghosts: /** @type {HTMLSelectElement} */ (event.target).value }),
);
