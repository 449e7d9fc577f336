// Orbits from the states along their flights: the cubics that take on position and velocity.

/**
 * An orbit as it is drawn: time in forcing periods, and positions and velocities, a row for each coordinate; a piece
 * for each flight. Walls have a place and a coordinate; `hits` are the coordinates that meet at the flights' starts.
 * @typedef {{t: number[], x: number[][], v: number[][]}} Flight
 * @typedef {{flights: Flight[], walls: [string, number, number][], hits: number[][], touched: (wall: string) => number[],
 *   places: Record<string, number>, coordinates: string[], span: number}} Motion
 */

const unpackedTracks = new WeakMap();

/**
 * The numbers of a family's tracks, unpacked once.
 * @param {Family} family
 * @returns {{rows: Numbers | null, states: Numbers, period: Numbers, walls: [string, Numbers][], each: number} | null}
 */
function tracksOf(family) {
  const { tracks } = family;
  if (!tracks) return null;
  if (!unpackedTracks.has(tracks)) {
    const each = 2 * tracks.coordinates.length * tracks.nodes.reduce((sum, n) => sum + n, 0);
    const rows = tracks.rows === null ? null : unpacked(tracks.rows, 1);
    unpackedTracks.set(tracks, {
      rows,
      each,
      states: unpacked(tracks.states, each * (rows?.length ?? family.rows)),
      period: unpacked(tracks.period, family.rows),
      walls: Object.entries(tracks.walls).map(([name, packed]) => [name, unpacked(packed, family.rows)]),
    });
  }
  return unpackedTracks.get(tracks);
}

/**
 * The row nearest to one whose orbit is kept.
 * @param {Family} family
 * @param {number} row
 */
function keptRow(family, row) {
  const rows = tracksOf(family)?.rows;
  if (!rows) return row;
  const at = d3.bisectCenter(/** @type {any} */ (rows), row);
  return rows[at];
}

/**
 * @param {Family} family
 * @param {number} row
 * @returns {Motion | null}
 */
function motionOf(family, row) {
  const tracks = tracksOf(family),
    nodes = family.tracks?.nodes ?? [];
  if (!tracks || !nodes.length) return null;
  const place = tracks.rows ? d3.bisectCenter(/** @type {any} */ (tracks.rows), row) : row;
  const T = tracks.period[row],
    from = family.starts[row],
    turn = Math.floor(family.times[from] / T);
  const { hits, coordinates } = /** @type {Tracks} */ (family.tracks),
    size = coordinates.length;
  let at = place * tracks.each;
  const flights = nodes.map((count, k) => {
    const begin = family.times[from + k];
    const end = k + 1 < nodes.length ? family.times[from + k + 1] : family.times[from] + family.period * T;
    const states = tracks.states.subarray(at, at + 2 * size * count);
    at += 2 * size * count;
    return flown(states, size, begin / T - turn, (end - begin) / T, T);
  });
  const alone = tracks.walls.filter(([name]) => hits[name].length === 1);
  return {
    flights,
    walls: alone.map(([name, values]) => [name, values[row], hits[name][0]]),
    places: Object.fromEntries(tracks.walls.map(([name, values]) => [name, values[row]])),
    hits: nodes.map((_, k) => hits[page.walls[family.walls[from + k]]]),
    touched: (wall) => hits[wall] ?? [],
    coordinates,
    span: family.period,
  };
}

/**
 * The walls, those that share a place together.
 * @param {Motion} motion
 * @returns {{names: string[], place: number, coordinate: number, look: string}[]}
 */
function wallsTogether({ walls }) {
  const groups = d3.groups(walls, ([, place, coordinate]) => `${coordinate} ${place}`);
  return groups.map(([, own]) => ({
    names: own.map(([name]) => name),
    place: own[0][1],
    coordinate: own[0][2],
    look: wallClass(page.walls.indexOf(own[0][0])),
  }));
}

/**
 * Positions and velocities of all coordinates at a time of a motion.
 * @param {Motion} motion
 * @param {number} time
 * @returns {{x: number, v: number}[]}
 */
function stateAt({ flights, coordinates }, time) {
  const flight = flights.find(({ t }) => time <= t[t.length - 1]) ?? flights[flights.length - 1];
  const k = Math.max(1, Math.min(flight.t.length - 1, d3.bisectLeft(flight.t, time)));
  const part = (time - flight.t[k - 1]) / (flight.t[k] - flight.t[k - 1] || 1);
  const between = (/** @type {number[]} */ values) => values[k - 1] + part * (values[k] - values[k - 1]);
  return coordinates.map((_, i) => ({ x: between(flight.x[i]), v: between(flight.v[i]) }));
}

const FINE = 6;

/**
 * A flight between its states, by the cubics that take on position and velocity.
 * @param {Numbers} states
 * @param {number} size
 * @param {number} begin
 * @param {number} length
 * @param {number} T
 * @returns {Flight}
 */
function flown(states, size, begin, length, T) {
  const steps = states.length / (2 * size) - 1,
    h = (length * T) / steps;
  const numbered = d3.range(size);
  const flight = {
    t: [begin],
    x: numbered.map((j) => [states[2 * j]]),
    v: numbered.map((j) => [states[2 * j + 1]]),
  };
  for (let i = 0; i < steps; i++) {
    for (let k = 1; k <= FINE; k++) flight.t.push(begin + (length * (i + k / FINE)) / steps);
    for (const j of numbered) {
      const from = 2 * (size * i + j),
        [a, p] = states.subarray(from, from + 2),
        [b, q] = states.subarray(from + 2 * size, from + 2 * size + 2);
      for (let k = 1; k <= FINE; k++) {
        const u = k / FINE;
        flight.x[j].push(cubic(u, h, a, b, p, q));
        flight.v[j].push(
          k === FINE || h === 0
            ? q
            : (6 * u * (1 - u) * (b - a)) / h + (1 - u) * (1 - 3 * u) * p + u * (3 * u - 2) * q,
        );
      }
    }
  }
  return flight;
}
