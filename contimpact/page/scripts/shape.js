// Branches as smooth lines: cubics in arclength between their points, as many pieces as the scale of the picture asks
// for, and as few points as it can show.

/** How far a chord may be from the cubic; how near to each other points are left out; what is drawn beyond the frame, in
 * pixels; how many rows are passed over at most. */
const BEND = 0.12,
  NEAR = 2.5,
  MARGIN = 40,
  FARTHEST = 256;

/**
 * Derivatives with respect to arclength; rows that coincide share one.
 * @param {Numbers} length
 * @param {Numbers} values
 */
function slopes(length, values) {
  const rows = length.length,
    tiny = 1e-9 * (length[rows - 1] - length[0]);
  /** @type {number[]} */
  const apart = [];
  const place = new Uint32Array(rows);
  for (let i = 0; i < rows; i++) {
    if (i === 0 || length[i] - length[i - 1] > tiny) apart.push(i);
    place[i] = apart.length - 1;
  }
  const n = apart.length,
    found = new Float64Array(n);
  if (n < 3) return new Float64Array(rows);
  const rise = (/** @type {number} */ k) =>
    (values[apart[k + 1]] - values[apart[k]]) / (length[apart[k + 1]] - length[apart[k]]);
  const step = (/** @type {number} */ k) => length[apart[k + 1]] - length[apart[k]];
  for (let k = 1; k < n - 1; k++) {
    found[k] = (rise(k - 1) * step(k) + rise(k) * step(k - 1)) / (step(k - 1) + step(k));
  }
  found[0] = rise(0) - ((rise(1) - rise(0)) * step(0)) / (step(0) + step(1));
  found[n - 1] = rise(n - 2) + ((rise(n - 2) - rise(n - 3)) * step(n - 2)) / (step(n - 3) + step(n - 2));
  return Float64Array.from(place, (k) => found[k]);
}

/** @typedef {{moveTo: (x: number, y: number) => void, lineTo: (x: number, y: number) => void}} Pen */
/**
 * A line over arclength, with derivatives; `status` is of the piece from a row to the next.
 * @typedef {{length: Numbers, x: Numbers, y: Numbers, dx: Numbers, dy: Numbers, status: ArrayLike<number>}} Line
 */

/**
 * Draw a line in pieces, each with the pen of its status.
 * @param {Line} line
 * @param {{x: Linear, y: Linear}} scale
 * @param {(Pen | null)[]} pens
 * @param {(x0: number, y0: number, x1: number, y1: number, status: number) => void} [seen] is told each piece
 */
function draw(line, scale, pens, seen) {
  const { length, x, y, dx, dy, status } = line,
    last = x.length - 1;
  const [ax, bx] = affine(scale.x),
    [ay, by] = affine(scale.y);
  const [left, right] = sorted(scale.x.range()),
    [top, bottom] = sorted(scale.y.range());
  /** @type {Pen | null} */
  let pen = null;
  let i = 0;
  while (i < last) {
    const x0 = ax * x[i] + bx,
      y0 = ay * y[i] + by,
      own = pens[status[i]];
    const away = Math.max(left - x0, x0 - right, top - y0, y0 - bottom, 0);
    const speed = Math.max(Math.abs(ax * dx[i]), Math.abs(ay * dy[i]));
    const next = i + jump(length, status, i, last, length[i] + Math.max(NEAR, away / 2) / speed);
    const x1 = ax * x[next] + bx,
      y1 = ay * y[next] + by;
    const shown =
      own &&
      Number.isFinite(y0) &&
      Number.isFinite(y1) &&
      Math.max(x0, x1) >= left - MARGIN &&
      Math.min(x0, x1) <= right + MARGIN &&
      Math.max(y0, y1) >= top - MARGIN &&
      Math.min(y0, y1) <= bottom + MARGIN;
    if (shown) {
      if (own !== pen) own.moveTo(x0, y0);
      bow(own, i, next, line, [ax, bx, ay, by]);
      own.lineTo(x1, y1);
      seen?.(x0, y0, x1, y1, status[i]);
    }
    pen = shown ? own : null;
    i = next;
  }
}

/**
 * How many rows to go on at once: less than an arclength, within one status.
 * @param {Numbers} length
 * @param {ArrayLike<number>} status
 * @param {number} i
 * @param {number} last
 * @param {number} reach
 */
function jump(length, status, i, last, reach) {
  let by = 1;
  while (by < FARTHEST && i + 2 * by <= last && length[i + 2 * by] <= reach) by *= 2;
  for (let k = 1; k < by; k++) if (status[i + k] !== status[i]) return k;
  return by;
}

/**
 * Points of the cubic between two rows, where the chord would be seen.
 * @param {Pen} pen
 * @param {number} i
 * @param {number} j
 * @param {Line} line
 * @param {[number, number, number, number]} scale
 */
function bow(pen, i, j, { length, x, y, dx, dy }, [ax, bx, ay, by]) {
  const h = length[j] - length[i];
  const bend = (h * Math.max(Math.abs(ax * (dx[j] - dx[i])), Math.abs(ay * (dy[j] - dy[i])))) / 8;
  const parts = Number.isFinite(bend) && bend > BEND ? Math.min(64, Math.ceil(Math.sqrt(bend / BEND))) : 1;
  for (let k = 1; k < parts; k++) {
    const u = k / parts;
    pen.lineTo(
      ax * cubic(u, h, x[i], x[j], dx[i], dx[j]) + bx,
      ay * cubic(u, h, y[i], y[j], dy[i], dy[j]) + by,
    );
  }
}

/** @param {number} u @param {number} h @param {number} a @param {number} b @param {number} da @param {number} db */
function cubic(u, h, a, b, da, db) {
  return a + u * (b - a) + u * (1 - u) * ((1 - u) * (h * da - (b - a)) - u * (h * db - (b - a)));
}

/** Factor and constant of a scale. @param {Linear} scale @returns {[number, number]} */
function affine(scale) {
  const [low, high] = scale.domain(),
    [a, b] = scale.range(),
    factor = (b - a) / (high - low);
  return [factor, a - factor * low];
}

/** @param {number[]} pair @returns {[number, number]} */
function sorted(pair) {
  return pair[0] < pair[1] ? [pair[0], pair[1]] : [pair[1], pair[0]];
}

/**
 * A family's line of some columns, its slopes kept.
 * @param {Family} family
 * @param {string} x
 * @param {{values: Numbers, name: string}} y
 */
function lineOf(family, x, y) {
  const length = family.columns.arclength,
    across = family.columns[x];
  return {
    length,
    x: across,
    y: y.values,
    status: family.status,
    dx: kept(family, `d ${x}`, () => slopes(length, across)),
    dy: kept(family, `d ${y.name}`, () => slopes(length, y.values)),
  };
}
