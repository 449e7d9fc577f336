// The catalogue as a table: sorted, filtered, linked both ways with the diagram; and the transitions.

/** @typedef {{name: string, title: string, of: (entry: Entry) => string | number | null, prose?: boolean}} Column */

const apart = [...new Set(page.members.flatMap((member) => Object.keys(member.fixed)))];

/** All columns, as downloads have them. @type {Column[]} */
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
    of: (entry) => entry.why ?? entry.reason ?? entry.criticality ?? beyond(entry) ?? "",
    prose: true,
  },
];

/** What the normal form says is seen beyond a grazing. @param {Entry} entry */
function beyond({ id }) {
  return page.reading.scenarios.find((scenario) => scenario.entry === id)?.text;
}

/** The columns of the table: of the parameters that vary along branches, that on the axis. */
function columnsShown() {
  const several = state.scope === "all" && apart.length > 0;
  return COLUMNS.filter(
    ({ name }) => name === state.x || (apart.includes(name) ? several : !page.varying.includes(name)),
  );
}

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
    .data(columnsShown())
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
  element("catalogue").hidden = page.entries.length === 0;
  const entries = inOrder(),
    columns = columnsShown();
  const rows = d3
    .select("#table tbody")
    .selectAll("tr")
    .data(entries, (/** @type {any} */ entry) => entry.id)
    .join("tr")
    .order()
    .attr("data-entry", ({ id }) => id)
    .on("click", (_, { id }) => pick(id));
  rows
    .selectAll("td")
    .data((entry) => columns.map((column) => ({ entry, column, value: column.of(entry) })))
    .join("td")
    .attr("class", ({ column, value }) =>
      column.prose ? "prose" : typeof value === "number" ? "number" : null,
    )
    .each(function ({ entry, column, value }) {
      const cell = /** @type {HTMLElement} */ (this);
      if (column.name === "id") cell.replaceChildren(chooser(entry.id, entry.id));
      else if (column.name === "label") cell.replaceChildren(labelOf(entry));
      else
        cell.textContent =
          typeof value === "number" ? shown(value, column.name === "error" ? 2 : 12) : (value ?? "-");
    });
  element("count").textContent = `${entries.length} of ${page.entries.length}`;
  markRow(false);
}

/** A button that chooses an event. @param {string} id @param {...(string | Node)} texts */
function chooser(id, ...texts) {
  const button = document.createElement("button");
  button.type = "button";
  button.append(...texts);
  button.addEventListener("click", (event) => {
    event.stopPropagation();
    pick(id);
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

/** An event in a sentence, with its value on the axis shown; a click chooses it. @param {string | null} id */
function eventChip(id) {
  const entry = entryById.get(id ?? "");
  if (!entry) return id ?? "";
  const value = entry.parameters[state.x] ?? familyById.get(entry.branch)?.columns[state.x]?.[entry.row];
  return chooser(entry.id, labelOf(entry), ` at ${symbol(state.x)} = ${shown(value, 6)}`);
}

/** A transition in words. @param {Transition} transition @returns {(string | Node)[]} */
function transitionText({ source, target, mechanism, entry, doubling, fold, doubled_grazings }) {
  const [graze, pd, fb] = [entry, doubling, fold].map(eventChip);
  const doubled = doubled_grazings.flatMap(([id], k) => [
    k ? ", " : "; its doubled orbits graze at ",
    eventChip(id),
  ]);
  const born = fold
    ? [`; ${target} begins unstable where ${source} grazes, and becomes stable in a fold, `, fb]
    : [];
  const head = `${source} to ${target}: `,
    tail = mechanism
      ? ` (mechanism ${mechanism}).`
      : ". The branches that were followed do not decide the mechanism.";
  if (mechanism === 1) return [head, `${source} grazes, `, graze, `, and ${target} is stable at once`, tail];
  const before = doubling
    ? [`${source} doubles its period, `, pd, ", before it would graze, ", graze]
    : [`${source} grazes, `, graze];
  const last =
    mechanism === 3
      ? fold
        ? `; ${target} is stable before the doubled family is lost`
        : `; ${target} is stable from that grazing on`
      : mechanism === 4
        ? "; nothing of the old family that was followed is stable there" +
          (page.reading.crises.length ? "" : ", and what ends the motion in between is not read")
        : "";
  return [head, ...before, ...doubled, ...born, last, tail];
}

/** A crisis in words. @param {Crisis} crisis @returns {(string | Node)[]} */
function crisisText({ entry, attractor, orbit, type, after }) {
  const beyond = type ? `beyond: ${after}.` : `of a type that simulation does not show; beyond: ${after}.`,
    does =
      type === "interior"
        ? "widens in an interior crisis on"
        : type
          ? `ends in a ${type} crisis on`
          : "meets, in a crisis,";
  return [`The chaos ${attractor} ${does} the unstable ${orbit}, `, eventChip(entry), `; ${beyond}`];
}

/** The transitions and crises that were read; the events in them can be chosen. */
function drawTransitions() {
  const { transitions, crises } = page.reading,
    texts = [...transitions.map(transitionText), ...crises.map(crisisText)];
  element("reading").hidden = texts.length === 0;
  element("transitions").replaceChildren(
    ...texts.map((text) => {
      const item = document.createElement("li");
      item.append(...text);
      return item;
    }),
  );
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
