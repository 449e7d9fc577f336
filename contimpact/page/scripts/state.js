// What is looked at, and the fragment of the address that cites it.

/**
 * `at` is what is chosen: an entry's name, or a family's with a row, as ``b2:34``.
 * @typedef {{view: string, member: number, x: string, y: string, xlim: [number, number] | null,
 *   ylim: [number, number] | null, hide: Set<string>, unphysical: string, at: string, filter: string,
 *   ghosts: string, scope: string, sort: string, panel: number, plane: [number, number, number, number] | null}} State
 */

/** @returns {State} */
function atFirst() {
  return {
    view: "diagram",
    member: page.own,
    x: page.shown.x,
    y: "velocity",
    xlim: null,
    ylim: null,
    hide: new Set(),
    unphysical: page.shown.unphysical,
    at: opening(page.own),
    filter: "",
    ghosts: "all",
    scope: "here",
    sort: "",
    panel: 0,
    plane: null,
  };
}

/**
 * What is chosen when a diagram opens: an event that ends its longest stable run, else another real event, else an
 * orbit; of those in sight, with impacts if there are any.
 * @param {number} member
 */
function opening(member) {
  const known = opened.get(member) ?? chosenFirst(member);
  opened.set(member, known);
  return known;
}

/** @type {Map<number, string>} */
const opened = new Map();

/** The same, looked for. @param {number} member */
function chosenFirst(member) {
  const [low, high] = page.shown.xlim ?? [-Infinity, Infinity],
    own = families.filter((family) => family.rows && memberOf(family) === member),
    hitting = own.filter(({ word }) => word);
  const runs = d3.sort(page.reading.stable, (run) => run.low - run.high),
    bounds = runs.flatMap(({ bounds }) => bounds.map((id) => entryById.get(id ?? ""))),
    real = [...bounds, ...page.entries].filter((entry) => entry && !entry.ghost);
  for (const among of [hitting, own]) {
    const rows = new Map(
      among.map((family) => [
        family.id,
        d3.range(family.rows).filter((row) => {
          const x = family.columns[page.shown.x]?.[row];
          return low <= x && x <= high;
        }),
      ]),
    );
    const event = real.find((entry) => entry && rows.get(entry.branch)?.includes(entry.row));
    if (event) return event.id;
    const best = d3.least(
      among.filter(({ id }) => rows.get(id)?.length),
      ({ id, status }) => d3.min(rows.get(id) ?? [], (row) => status[row]) ?? 9,
    );
    const there = best ? (rows.get(best.id) ?? []) : [],
      least = d3.min(there, (row) => best?.status[row]),
      good = there.filter((row) => best?.status[row] === least);
    if (best) return `${best.id}:${good[Math.floor(good.length / 2)]}`;
  }
  return "";
}

const state = atFirst();

/** @type {((changed: Set<string>) => void)[]} */
const observers = [];

/**
 * Change what is looked at; everything that shows it follows.
 * @param {Partial<State>} changes
 */
function change(changes) {
  Object.assign(state, changes);
  for (const observer of observers) observer(new Set(Object.keys(changes)));
  clearTimeout(waiting);
  waiting = setTimeout(cite, 200); // browsers refuse to write the address often
}

let waiting = 0;

/** Write the state to the address. */
function cite() {
  const text = fragment();
  if (text !== location.hash.slice(1) && location.protocol !== "about:")
    history.replaceState(null, "", `#${text}`);
}

/** The state as a fragment: what differs from the beginning. */
function fragment() {
  const first = atFirst(),
    parts = new URLSearchParams();
  for (const [name, value] of Object.entries(state)) {
    const before = /** @type {any} */ (first)[name];
    if (value instanceof Set) {
      if (value.size) parts.set(name, [...value].join(","));
    } else if (Array.isArray(value)) {
      parts.set(name, value.map((number) => String(Number(number.toPrecision(9)))).join(","));
    } else if (value !== before) parts.set(name, String(value));
  }
  return parts.toString();
}

/**
 * So many finite numbers, or null.
 * @param {string | null} text
 * @param {number} count
 */
function numbersIn(text, count) {
  const found = (text ?? "").split(",").map(Number);
  const whole = text !== null && text !== "" && found.length === count && found.every(Number.isFinite);
  return whole && found.every((value, k) => k % 2 === 0 || found[k - 1] < value)
    ? /** @type {any} */ (found)
    : null;
}

/** The state that the fragment cites; what it cannot mean is left as at first. @returns {State} */
function cited() {
  const parts = new URLSearchParams(location.hash.slice(1)),
    found = atFirst();
  const one = (/** @type {string} */ name, /** @type {string[]} */ known, /** @type {string} */ first) => {
    const value = parts.get(name) ?? first;
    return known.includes(value) ? value : first;
  };
  const whole = (/** @type {string} */ name, /** @type {number} */ below, /** @type {number} */ first) => {
    const value = Number(parts.get(name) ?? first);
    return Number.isInteger(value) && value >= 0 && value < below ? value : first;
  };
  const member = whole("member", page.members.length, found.member),
    at = parts.get("at");
  return {
    view: one("view", page.curves.length ? ["diagram", "plane"] : ["diagram"], "diagram"),
    member,
    x: one("x", page.varying, found.x),
    y: one("y", ["velocity", "multiplier", "gap", ...Object.keys(COLUMNS_DRAWN)], "velocity"),
    xlim: numbersIn(parts.get("xlim"), 2),
    ylim: numbersIn(parts.get("ylim"), 2),
    hide: new Set((parts.get("hide") ?? "").split(",").filter(Boolean)),
    unphysical: one("unphysical", ["none", "period-1", "all"], found.unphysical),
    at: at === "" ? "" : chosenIn(at ?? "") || opening(member),
    filter: parts.get("filter") ?? "",
    ghosts: one("ghosts", ["all", "real", "ghost"], "all"),
    scope: one("scope", ["here", "all"], "here"),
    sort: parts.get("sort") ?? "",
    panel: whole("panel", page.panels.length, 0),
    plane: numbersIn(parts.get("plane"), 4),
  };
}

/**
 * A choice, if there is such an entry or row.
 * @param {string} text
 */
function chosenIn(text) {
  return placeOf(text) ? text : "";
}

/**
 * Family, row and entry of a choice.
 * @param {string} at
 * @returns {{family: Family, row: number, entry: Entry | null} | null}
 */
function placeOf(at) {
  const entry = entryById.get(at);
  if (entry) {
    const family = familyById.get(entry.branch);
    return family ? { family, row: entry.row, entry } : null;
  }
  const [name, number] = at.split(":"),
    family = familyById.get(name),
    row = Number(number);
  if (!family || !number || !Number.isInteger(row) || row < 0 || row >= family.rows) return null;
  return { family, row, entry: null };
}

/**
 * The member of the diagram that a family belongs to; that of attractors is found by their parameters.
 * @param {Family} family
 */
function memberOf(family) {
  const place = families.indexOf(family);
  const found = page.members.findIndex((member) =>
    family.branch
      ? member.branches.includes(place)
      : Object.entries(member.fixed).every(([name, value]) => family.columns[name]?.[0] === value),
  );
  return Math.max(found, 0);
}

/**
 * Choose an orbit: the diagram that has it is shown.
 * @param {string} at
 */
function choose(at) {
  const place = placeOf(at);
  if (!place) return;
  const member = memberOf(place.family);
  change(
    member === state.member
      ? { at, view: "diagram" }
      : { at, member, view: "diagram", xlim: null, ylim: null },
  );
}

/**
 * Choose an orbit, and bring it into sight where it stands elsewhere on a narrow screen.
 * @param {string} at
 */
function pick(at) {
  choose(at);
  if (matchMedia("(max-width: 52rem)").matches) element("orbit").scrollIntoView({ behavior: "smooth" });
}

/** The choice of a row: the event that stands on it, if one does. @param {Family} family @param {number} row */
function atRow(family, row) {
  const entry = page.entries.find((one) => one.branch === family.id && one.row === row);
  return entry ? entry.id : `${family.id}:${row}`;
}
