// What the page shows: the data block, its numbers unpacked.
// Each file here is part of one script; names declared at the top of a file are known to those after it.

/** A column: one number where it is constant, else a kind and base64. @typedef {number | string} Packed */
/** @typedef {Float64Array | Float32Array | Uint32Array | Uint8Array} Numbers */

/**
 * States along the flights of some orbits; `rows` are theirs, null for all. A state has position and velocity of each
 * coordinate; `hits` are the coordinates, by their places, of which the gap to a wall is made.
 * @typedef {{period: Packed, walls: Record<string, Packed>, hits: Record<string, number[]>, coordinates: string[],
 *   rows: Packed | null, nodes: number[], states: Packed}} Tracks
 */
/**
 * @typedef {{id: string, word: string, period: number, notation: string, parameter: string, from: string | null,
 *   rows: number, ends: string[], missed: string[], notes: string[], columns: Record<string, Packed>,
 *   times: Packed, velocities: Packed, multipliers: Packed, unstable: Packed, physical: Packed, status: Packed,
 *   reasons: string[], reason: Packed, nearest: string[], margin_event: Packed, tracks: Tracks | null}} Branch
 */
/**
 * @typedef {{direction: string, kind: string, notation: string, word: string, period: number | null, rows: number,
 *   columns: Record<string, Packed>, starts: Packed, times: Packed, velocities: Packed, walls: Packed,
 *   multipliers: Packed, tracks: Tracks | null}} Swept
 */
/**
 * Basin fractions: parts of random starts, with their intervals, at the values of the columns.
 * @typedef {{columns: Record<string, number[]>, motions: {name: string, parts: number[], low: number[],
 *   high: number[]}[]}} Fractions
 */
/** @typedef {{wall: string, time: number, velocity: number}} Impact */
/** A label as it is set. @typedef {{symbol: string, tilde: boolean, below: string, above: string}} Parts */
/**
 * @typedef {{id: string, kind: string, ghost: boolean, label: string, parts: Parts, why: string | null, branch: string,
 *   word: string, period: number, notation: string, wall: string | null, touch_time: number | null,
 *   parameter: string, parameters: Record<string, number>, impacts: Impact[],
 *   multipliers: ([number, number] | null)[], stable: boolean, physical: boolean, reason: string | null,
 *   criticality: string | null, residual: number, error: number | null, method: string, opens: string[],
 *   row: number}} Entry
 */
/**
 * @typedef {{id: string, kind: string, label: string, word: string, notation: string, parameters: [string, string],
 *   fixed: Record<string, number>, rows: number, columns: Record<string, Packed>, ghost: Packed, key: number, ends: string[],
 *   missed: string[], points: {kind: string, changes: string, parameters: Record<string, number>}[]}} Curve
 */
/**
 * @typedef {{branch: string, notation: string, low: number, high: number, rows: [number, number],
 *   bounds: (string | null)[]}} Run
 */
/**
 * @typedef {{id: string, orbits: {notation: string, ends: string | null}[], polygon: [number, number][][],
 *   part: number, says: string, doubt: string}} Area
 */
/**
 * @typedef {{fixed: Record<string, number>, along: string, across: string, curves: number[], areas: Area[],
 *   regions: {low: number, high: number, first: string, notation: string, branch: string, said: string,
 *     lane: number}[]}} Panel
 */
/** A bifurcation that curves are of. @typedef {{kind: string, label: string, notation: string, parts: Parts, colour: string}} Key */
/**
 * What the machine is drawn with: `direction` is an angle below the horizontal or the parameter that is it; pairs of
 * bodies, by their coordinates; -1 is what is fixed.
 * @typedef {{direction: number | string, springs: [number, number][], contained: [number, number][], turning: boolean,
 *   guards: Record<string, {side: number, row: number[], soft: boolean, rigid: boolean}>}} Geometry
 */
/**
 * @typedef {{source: string, target: string, mechanism: number | null, entry: string, doubling: string | null,
 *   fold: string | null, doubled_grazings: [string, number][]}} Transition
 */
/**
 * An attractor along the parameter: where it begins and ends, on the axes there are, and what happens there.
 * @typedef {{notation: string, branch: string | null, columns: Record<string, [number, number]>, said: string}} Known
 */
/** @typedef {{entry: string, attractor: string, orbit: string, type: string | null, after: string}} Crisis */
/**
 * @typedef {{name: string, version: string, parameter: string, varying: string[], quantities: string[],
 *   fixed: Record<string, number>, units: Record<string, string>, walls: string[], every: number, own: number, unknown: string | null,
 *   greek: Record<string, string>, pi_below: number, pi_above: number,
 *   shown: {x: string, xlim: [number, number] | null, ylim: [number, number] | null, unphysical: string,
 *     source: string, remarks: string[], margin: number | null},
 *   members: {fixed: Record<string, number>, branches: number[]}[], branches: Branch[], entries: Entry[],
 *   looks: Record<string, {marker: string, colour: string, touching: boolean}>,
 *   reading: {stable: Run[], transitions: Transition[], crises: Crisis[], scenarios: {entry: string, text: string}[],
 *     incomplete: string}, machine: Geometry | null, keys: Key[],
 *   curves: Curve[], panels: Panel[], swept: Swept[], fractions: Fractions | null, motions: Known[]}} Page
 */

/**
 * An element of the page by its id.
 * @template {Element} [E=HTMLElement]
 * @param {string} id
 * @returns {E}
 */
function element(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`no element ${id}`);
  return /** @type {any} */ (found);
}

/** @type {Page} */
const page = JSON.parse(element("data").textContent ?? "");

/** @type {Record<string, new (bytes: ArrayBuffer) => Numbers>} */
const ARRAYS = {
  f8: Float64Array,
  f4: Float32Array,
  u4: Uint32Array,
  u1: Uint8Array,
};

/**
 * The numbers of a column of a length.
 * @param {Packed} packed
 * @param {number} length
 * @returns {Numbers}
 */
function unpacked(packed, length) {
  if (typeof packed === "number") return new Float64Array(length).fill(packed);
  const bytes = Uint8Array.from(atob(packed.slice(3)), (letter) => letter.charCodeAt(0));
  return new ARRAYS[packed.slice(0, 2)](bytes.buffer);
}

/**
 * Orbits of one word along a parameter: a branch, or attractors of one kind; motions that are not periodic have no
 * word. Impact j of row i stands at `starts[i] + j`; `status` is of the piece from a row to the next: 0 stable,
 * 1 unstable, 2 unphysical, 3 unknown.
 * @typedef {{id: string, layer: "branch" | "swept", notation: string, word: string, period: number, rows: number,
 *   columns: Record<string, Numbers>, starts: Numbers, times: Numbers, velocities: Numbers, walls: Numbers,
 *   multipliers: Numbers, unstable: Numbers | null, physical: Numbers | null, status: Uint8Array,
 *   reason: (row: number) => string, nearest: (row: number) => string, tracks: Tracks | null, branch: Branch | null, swept: Swept | null,
 *   parameter: string, made: Map<string, Numbers>}} Family
 */

const STATUS = ["stable", "unstable", "unphysical", "unknown"];

/**
 * @param {Record<string, Packed>} columns
 * @param {number} rows
 */
function unpackedAll(columns, rows) {
  return Object.fromEntries(Object.entries(columns).map(([name, packed]) => [name, unpacked(packed, rows)]));
}

/**
 * @param {Branch} branch
 * @returns {Family}
 */
function familyOfBranch(branch) {
  const { rows, word } = branch,
    count = word.length;
  const unstable = unpacked(branch.unstable, rows),
    physical = unpacked(branch.physical, rows);
  const reason = unpacked(branch.reason, rows),
    event = unpacked(branch.margin_event, rows);
  return {
    id: branch.id,
    layer: "branch",
    notation: branch.notation,
    word,
    period: branch.period,
    rows,
    columns: unpackedAll(branch.columns, rows),
    parameter: branch.parameter,
    starts: Uint32Array.from({ length: rows + 1 }, (_, row) => row * count),
    times: unpacked(branch.times, rows * count),
    velocities: unpacked(branch.velocities, rows * count),
    walls: Uint8Array.from({ length: rows * count }, (_, k) => page.walls.indexOf(word[k % count])),
    multipliers: unpacked(branch.multipliers, 4 * rows),
    unstable,
    physical,
    status: Uint8Array.from(unpacked(branch.status, rows)),
    reason: (row) => branch.reasons[reason[row]],
    nearest: (row) => branch.nearest[event[row]],
    tracks: branch.tracks,
    branch,
    swept: null,
    made: new Map(),
  };
}

/**
 * @param {Swept} swept
 * @param {number} place
 * @returns {Family}
 */
function familyOfSwept(swept, place) {
  const starts = unpacked(swept.starts, swept.rows + 1),
    count = starts[swept.rows];
  return {
    id: `a${place + 1}`,
    layer: "swept",
    notation: swept.notation,
    word: swept.word,
    period: swept.period ?? 1,
    rows: swept.rows,
    columns: unpackedAll(swept.columns, swept.rows),
    parameter: page.parameter,
    starts,
    times: unpacked(swept.times, count),
    velocities: unpacked(swept.velocities, count),
    walls: unpacked(swept.walls, count),
    multipliers: unpacked(swept.multipliers, 4 * swept.rows),
    unstable: null,
    physical: null,
    status: new Uint8Array(swept.rows),
    reason: () => "",
    nearest: () => "",
    tracks: swept.tracks,
    branch: null,
    swept,
    made: new Map(),
  };
}

const families = [...page.branches.map(familyOfBranch), ...page.swept.map(familyOfSwept)];
const familyById = new Map(families.map((family) => [family.id, family]));
const entryById = new Map(page.entries.map((entry) => [entry.id, entry]));

/**
 * What is kept of a family once it was made.
 * @param {Family} family
 * @param {string} name
 * @param {() => Numbers} make
 */
function kept(family, name, make) {
  const known = family.made.get(name) ?? make();
  family.made.set(name, known);
  return known;
}

/**
 * Every n-th of some numbers, from one on.
 * @param {Numbers} numbers
 * @param {number} from
 * @param {number} n
 */
function every(numbers, from, n) {
  return Float64Array.from({ length: Math.floor(numbers.length / n) }, (_, row) => numbers[row * n + from]);
}

/**
 * Sizes of the multipliers of each row, the j-th of m.
 * @param {Family} family
 * @param {number} j
 */
function moduli(family, j) {
  const m = family.multipliers.length / (2 * family.rows),
    all = family.multipliers;
  return Float64Array.from({ length: family.rows }, (_, i) => {
    const at = 2 * (i * m + j);
    return Math.hypot(all[at], all[at + 1]);
  });
}

const COLUMN = "column:";
/** The margin and outputs as y: what their names have before them, and a reader's names. @type {Record<string, string>} */
const COLUMNS_DRAWN = Object.fromEntries(
  page.quantities.map((name) => [COLUMN + name, name === "margin" ? "margin (tolerances)" : name]),
);

/**
 * What is drawn of a branch over the x axis: lines, each of a wall or of none (-1).
 * @param {Family} family
 * @param {string} y
 * @returns {{wall: number, values: Numbers, name: string}[]}
 */
function linesOf(family, y) {
  const numbered = (/** @type {number} */ n) => Array.from({ length: n }, (_, j) => j);
  if (y === "gap") return [{ wall: -1, values: family.columns.smallest_gap, name: "gap" }];
  if (y.startsWith(COLUMN)) {
    const name = y.slice(COLUMN.length);
    return [{ wall: -1, values: family.columns[name], name }];
  }
  if (y === "multiplier") {
    return numbered(family.multipliers.length / (2 * family.rows)).map((j) => {
      const name = `|mu${j + 1}|`;
      return {
        wall: -1,
        values: kept(family, name, () => moduli(family, j)),
        name,
      };
    });
  }
  const count = family.word.length;
  return numbered(count).map((k) => {
    const name = `v${k + 1}`,
      values = kept(family, name, () => every(family.velocities, k, count));
    return { wall: family.walls[k], values, name };
  });
}
