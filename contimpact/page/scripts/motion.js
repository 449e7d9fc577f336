// Orbits from the states along their flights: the cubics that take on position and velocity.

/**
 * An orbit as it is drawn: time in forcing periods, position, velocity; a piece for each flight.
 * @typedef {{flights: {t: number[], x: number[], v: number[]}[], walls: [string, number][], span: number}} Motion
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
    const each = 2 * tracks.nodes.reduce((sum, n) => sum + n, 0);
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
  let at = place * tracks.each;
  const flights = nodes.map((count, k) => {
    const begin = family.times[from + k];
    const end = k + 1 < nodes.length ? family.times[from + k + 1] : family.times[from] + family.period * T;
    const flight = flown(tracks.states.subarray(at, at + 2 * count), begin / T - turn, (end - begin) / T, T);
    at += 2 * count;
    return flight;
  });
  return {
    flights,
    walls: tracks.walls.map(([name, values]) => [name, values[row]]),
    span: family.period,
  };
}

const FINE = 6;

/**
 * A flight between its states, by the cubics that take on position and velocity.
 * @param {Numbers} states
 * @param {number} begin
 * @param {number} length
 * @param {number} T
 */
function flown(states, begin, length, T) {
  const steps = states.length / 2 - 1,
    h = (length * T) / steps;
  const flight = { t: [begin], x: [states[0]], v: [states[1]] };
  for (let i = 0; i < steps; i++) {
    const [a, p, b, q] = states.subarray(2 * i, 2 * i + 4);
    for (let k = 1; k <= FINE; k++) {
      const u = k / FINE;
      flight.t.push(begin + (length * (i + u)) / steps);
      flight.x.push(cubic(u, h, a, b, p, q));
      flight.v.push(
        k === FINE || h === 0
          ? q
          : (6 * u * (1 - u) * (b - a)) / h + (1 - u) * (1 - 3 * u) * p + u * (3 * u - 2) * q,
      );
    }
  }
  return flight;
}
