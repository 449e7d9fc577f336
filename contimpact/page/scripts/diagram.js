// The bifurcation diagram: branches, events, attractors, the strip of stable runs; zoom, hover, choice.

const diagram = d3.select("#diagram");
const HEIGHT = 560,
  LANE = 17;
/** Wheel and hover go by what was drawn last. @type {{box: Box, limits: Limits, x: Linear, y: Linear}} */
let drawn = {
  box: { left: 0, right: 1, top: 0, bottom: 1 },
  limits: { x: [0, 1], y: [0, 1] },
  x: d3.scaleLinear(),
  y: d3.scaleLinear(),
};

const hidden = (/** @type {string} */ name) => state.hide.has(name);

/** The families that the diagram shows now. @param {"branch" | "swept"} layer */
function shownFamilies(layer) {
  return families.filter(
    (family) =>
      family.layer === layer &&
      memberOf(family) === state.member &&
      !hidden(layer === "branch" ? family.id : wayOf(/** @type {Swept} */ (family.swept))),
  );
}

/** Whether rows of a status are drawn. @param {Family} family @param {number} status */
function statusShown(family, status) {
  if (hidden(STATUS[status])) return false;
  if (STATUS[status] !== "unphysical") return true;
  return state.unphysical === "all" || (state.unphysical === "period-1" && family.period === 1);
}

/** Whether a line's wall is drawn. @param {number} wall */
function wallShown(wall) {
  return wall < 0 || !hidden(`wall ${page.walls[wall]}`);
}

/** The entries that are drawn. */
function shownEntries() {
  return page.entries.filter((entry) => {
    const family = familyById.get(entry.branch);
    return (
      family &&
      memberOf(family) === state.member &&
      !hidden(entry.branch) &&
      !hidden(entry.ghost ? "ghosts" : "events") &&
      (entry.physical ||
        state.unphysical === "all" ||
        (state.unphysical === "period-1" && entry.period === 1))
    );
  });
}

const UNKNOWN = STATUS.indexOf("unknown");

/** The status of the orbit of a row itself, also where that of the way to the next one is unknown. @param {Family} family @param {number} row */
function ownStatus(family, row) {
  return family.physical?.[row] ? (family.unstable?.[row] ? 1 : 0) : 2;
}

/** All points that count: for the limits at first, for hover and for tables. @param {(family: Family, row: number, k: number, x: number, y: number, wall: number) => void} visit */
function visitPoints(visit) {
  for (const family of shownFamilies("branch")) {
    const across = family.columns[state.x];
    linesOf(family, state.y).forEach((line, k) => {
      if (!across || !line.values || !wallShown(line.wall)) return;
      for (let row = 0; row < family.rows; row++) {
        if (statusShown(family, family.status[row] === UNKNOWN ? ownStatus(family, row) : family.status[row]))
          visit(family, row, k, across[row], line.values[row], line.wall);
      }
    });
  }
  if (state.y !== "velocity") return;
  for (const family of shownFamilies("swept")) {
    const across = family.columns[state.x];
    for (let row = 0; across && row < family.rows; row++) {
      for (let at = family.starts[row]; at < family.starts[row + 1]; at++) {
        if (wallShown(family.walls[at]))
          visit(family, row, at - family.starts[row], across[row], family.velocities[at], family.walls[at]);
      }
    }
  }
}

/** The limits at first: those of the scene, else all that is drawn. @returns {Limits} */
function home() {
  const given = state.x === page.shown.x ? page.shown.xlim : null;
  /** @type {[number, number]} */
  const x = [Infinity, -Infinity],
    y = [0, 0];
  visitPoints((_family, _row, _k, place) => {
    x[0] = Math.min(x[0], place);
    x[1] = Math.max(x[1], place);
  });
  const across = given ?? (x[0] <= x[1] ? widened(x, 0.02) : [0, 1]);
  visitPoints((_family, _row, _k, place, value) => {
    if (!(across[0] <= place && place <= across[1] && Number.isFinite(value))) return;
    if (state.y === "multiplier" && value > 5) value = 5; // large ones are found by zooming out
    y[0] = Math.min(y[0], value);
    y[1] = Math.max(y[1], value);
  });
  const up = state.y === "velocity" ? page.shown.ylim : null;
  return { x: across, y: up ?? widened(y, 0.06) };
}

/** @type {Record<string, string>} */
const Y_NAMES = {
  ...COLUMNS_DRAWN,
  velocity: "impact velocity (before impact)",
  multiplier: "size of multipliers",
  gap: "smallest gap",
};

/** Draw everything anew. */
function drawDiagram() {
  const first = state.xlim && state.ylim ? null : home();
  /** @type {Limits} */
  const limits = {
    x: state.xlim ?? first?.x ?? [0, 1],
    y: state.ylim ?? first?.y ?? [0, 1],
  };
  const runs = lanes(),
    wide = element("diagram").parentElement?.clientWidth ?? 600,
    key = keyItems(wide - leftRoom(limits.y, 7) - 28, limits.x);
  const below = HEIGHT - 30 + LANE * runs.length;
  const width = sized(diagram, below + 30 + bandsHeight() + ROW * (d3.max(key, (item) => item.row) ?? 0)),
    narrow = width < 520;
  const box = {
    left: leftRoom(limits.y, 7),
    right: width - 22,
    top: labelRoom(limits.x),
    bottom: HEIGHT - 74,
  };
  const x = d3.scaleLinear(limits.x, [box.left, box.right]),
    y = d3.scaleLinear(limits.y, [box.bottom, box.top]);
  drawn = { box, limits, x, y };
  const names = {
    x: withUnit(state.x),
    y: Y_NAMES[state.y],
    ticks: /** @type {[number, number]} */ ([narrow ? 4 : 9, 7]),
  };
  const inside = drawFrame(diagram, box, { x, y }, names);
  const level = state.y === "multiplier" ? 1 : 0;
  inside
    .selectAll("line.zero")
    .data([level])
    .join("line")
    .attr("class", "zero")
    .attr("x1", box.left)
    .attr("x2", box.right)
    .attr("y1", y(level))
    .attr("y2", y(level));
  shadeMargins(group(inside, "margins"));
  drawBranches(group(inside, "branches"));
  drawSwept(group(inside, "attractors"));
  drawEvents(group(inside, "events"));
  nameOrbits(group(inside, "names"));
  drawSelection(group(inside, "chosen"));
  group(inside, "pointer").selectAll("*").remove();
  drawWallNames(group(diagram, "walls"));
  drawLabels(group(diagram, "labels"));
  drawLanes(group(diagram, "lanes"), runs);
  drawBands(group(diagram, "bands"), below);
  drawKey(group(diagram, "key"), key, below + 8 + bandsHeight());
  const said =
    `Bifurcation diagram of ${page.name}: ${Y_NAMES[state.y]} against ${withUnit(state.x)} from ` +
    `${shown(limits.x[0], 5)} to ${shown(limits.x[1], 5)}; ${shownFamilies("branch").length} branches, ${shownEntries().length} events. ` +
    "Use the arrow keys to go along a branch, or the table of events below.";
  diagram.attr("aria-label", said);
}

/** @param {number} wall */
function wallClass(wall) {
  return wall < 0 ? "nowall" : `wall${wall % 6}`;
}

/** One path for each wall and status. @param {Selected} layer */
function drawBranches(layer) {
  /** @type {Map<string, d3.Path>} */
  const paths = new Map();
  wallEnds.clear();
  clearNames();
  const pen = (/** @type {string} */ name) => {
    const known = paths.get(name) ?? d3.pathRound(2);
    paths.set(name, known);
    return known;
  };
  for (const family of shownFamilies("branch")) {
    if (!family.columns[state.x]) continue;
    for (const line of linesOf(family, state.y)) {
      if (!line.values || !wallShown(line.wall)) continue;
      const pens = STATUS.map((name, status) =>
        statusShown(family, status) ? pen(`${wallClass(line.wall)} ${name}`) : null,
      );
      const named = stretchOf(family.notation);
      draw(lineOf(family, state.x, line), drawn, pens, (...piece) => {
        noteEnd(line.wall, ...piece);
        named(...piece);
      });
    }
  }
  layer
    .selectAll("path")
    .data([...paths])
    .join("path")
    .attr("class", ([name]) => `branch ${name}`)
    .attr("d", ([, path]) => path.toString());
}

/** The limit of margins, as its toggle and the key say it. */
const SMALL = page.shown.margin === null ? "" : `margin below ${shown(page.shown.margin)}`;

/** Shade stretches of stable orbits with a small margin. @param {Selected} layer */
function shadeMargins(layer) {
  const pen = d3.pathRound(2),
    limit = page.shown.margin ?? 0,
    [ax, bx] = affine(drawn.x),
    [ay, by] = affine(drawn.y);
  for (const family of SMALL && !hidden(SMALL) ? shownFamilies("branch") : []) {
    const known = family.columns.margin;
    if (!known || !family.columns[state.x]) continue;
    for (const line of linesOf(family, state.y)) {
      if (!line.values || !wallShown(line.wall)) continue;
      const { length, x, y, dx, dy, status } = lineOf(family, state.x, line);
      for (let i = 0; i + 1 < family.rows; i++) {
        const [low, high] = partBelow(known[i], known[i + 1], limit),
          h = length[i + 1] - length[i];
        if (!(low < high) || !statusShown(family, status[i])) continue;
        const at = (/** @type {Numbers} */ of, /** @type {Numbers} */ slope, /** @type {number} */ u) => {
          const chord = (of[i + 1] - of[i]) / h,
            [a, b] = [slope[i], slope[i + 1]].map((one) => (Number.isFinite(one) ? one : chord));
          return cubic(u, h, of[i], of[i + 1], a, b);
        };
        d3.range(9).forEach((k) => {
          const u = low + ((high - low) * k) / 8;
          pen[k ? "lineTo" : "moveTo"](ax * at(x, dx, u) + bx, ay * at(y, dy, u) + by);
        });
      }
    }
  }
  layer
    .selectAll("path")
    .data([String(pen)])
    .join("path")
    .attr("class", "branch small")
    .attr("d", String);
}

/** Between which parts of a step from one value to another it is no more than a limit.
 * @param {number} from @param {number} to @param {number} limit @returns {[number, number]} */
function partBelow(from, to, limit) {
  const at = (limit - from) / (to - from);
  if (from <= limit && to <= limit) return [0, 1];
  if (from <= limit) return [0, Number.isFinite(to) ? at : 0];
  return to <= limit ? [Number.isFinite(from) ? at : 1, 1] : [0, 0];
}

/** How the drawn axis changes along a sweep: 1 where it rises with the parameter. @param {Family} family */
function riseOf({ columns }) {
  const across = columns[page.shown.x] ?? columns[page.parameter],
    [low, high] = [d3.minIndex, d3.maxIndex].map((of) => of(/** @type {any} */ (columns[page.parameter])));
  return Math.sign(across[high] - across[low]);
}

/** Ways of simulating, that first along which the drawn axis falls, as in pictures. */
const ways = [
  ...new Set(
    d3
      .sort(
        families.filter(({ swept }) => swept),
        (family) => {
          const direction = family.swept?.direction;
          return direction === "random" ? 2 : (direction === "up" ? 1 : -1) * riseOf(family);
        },
      )
      .map(({ swept }) => wayOf(/** @type {Swept} */ (swept))),
  ),
];

/** An open circle. @param {d3.Path} path @param {number} x @param {number} y */
function ring(path, x, y) {
  path.moveTo(x + 2.6, y);
  path.arc(x, y, 2.6, 0, 2 * Math.PI);
}

/** @param {d3.Path} path @param {number} x @param {number} y */
function cross(path, x, y) {
  for (const [dx, dy] of [
    [-2.5, -2.5],
    [-2.5, 2.5],
  ]) {
    path.moveTo(x + dx, y + dy);
    path.lineTo(x - dx, y - dy);
  }
}

/** @param {d3.Path} path @param {number} x @param {number} y */
function diamond(path, x, y) {
  path.moveTo(x, y - 3);
  for (const [dx, dy] of [
    [3, 3],
    [-3, 3],
    [-3, -3],
  ])
    path.lineTo((x += dx), (y += dy));
  path.closePath();
}

/** The marker of a way of simulating, as in pictures. @param {number} way */
function markOf(way) {
  return page.swept.some((swept) => wayOf(swept) === ways[way] && swept.direction === "random")
    ? diamond
    : way
      ? cross
      : ring;
}

/** The same as a path. @param {number} way @param {number} x @param {number} y */
function markPath(way, x, y) {
  const pen = d3.path();
  markOf(way)(pen, x, y);
  return String(pen);
}

/** Whether the first way of simulating has met an attractor, too. @param {Family} family @param {number} row */
function metBefore(family, row) {
  const own = family.velocities.slice(family.starts[row], family.starts[row + 1]);
  return families.some(
    (one) =>
      one.swept &&
      one.word &&
      one.word === family.word &&
      wayOf(one.swept) === ways[0] &&
      one.columns[page.parameter].some(
        (/** @type {number} */ value, /** @type {number} */ at) =>
          value === family.columns[page.parameter][row] &&
          own.every((speed, k) => Math.abs(speed - one.velocities[one.starts[at] + k]) < 1e-6),
      ),
  );
}

/** Attractors in the colours of their walls; those of another way where the first has not met them.
 * @param {Selected} layer */
function drawSwept(layer) {
  /** @type {Map<string, d3.Path>} */
  const paths = new Map();
  const mark = (
    /** @type {number} */ way,
    /** @type {number} */ wall,
    /** @type {number} */ x,
    /** @type {number} */ speed,
  ) => {
    const name = `swept ${wallClass(wall)}`,
      path = paths.get(name) ?? d3.pathRound(1),
      y = drawn.y(speed);
    paths.set(name, path);
    markOf(way)(path, x, y);
    cover(x, y);
  };
  for (const family of state.y === "velocity" ? shownFamilies("swept") : []) {
    const across = family.columns[state.x],
      way = ways.indexOf(wayOf(/** @type {Swept} */ (family.swept)));
    const met = kept(family, "met", () =>
      Uint8Array.from({ length: family.rows }, (_, row) => Number(way > 0 && metBefore(family, row))),
    );
    for (let row = 0; across && row < family.rows; row++) {
      const x = drawn.x(across[row]);
      if (!(x >= drawn.box.left - 5 && x <= drawn.box.right + 5) || met[row]) continue;
      if (family.starts[row] === family.starts[row + 1]) mark(way, -1, x, 0);
      for (let at = family.starts[row]; at < family.starts[row + 1]; at++)
        if (wallShown(family.walls[at])) {
          mark(way, family.walls[at], x, family.velocities[at]);
          noteEnd(family.walls[at], x, drawn.y(family.velocities[at]), x, drawn.y(family.velocities[at]), 1);
        }
    }
  }
  layer
    .selectAll("path")
    .data([...paths])
    .join("path")
    .attr("class", ([name]) => name)
    .attr("d", ([, path]) => path.toString());
}

/** @type {Record<string, d3.SymbolType>} */
const SHAPES = {
  o: d3.symbolCircle,
  s: d3.symbolSquare,
  "^": d3.symbolTriangle,
  v: d3.symbolTriangle,
  D: d3.symbolDiamond,
  "*": d3.symbolStar,
  X: d3.symbolCross,
};

/** The outline of a kind's marker. @param {string} kind @param {number} [size] */
function marker(kind, size = 52) {
  return d3.symbol(SHAPES[page.looks[kind]?.marker] ?? d3.symbolWye, size)() ?? "";
}

/** Where a kind's marker stands. @param {string} kind @param {number} x @param {number} y */
function placed(kind, x, y) {
  return `translate(${x.toFixed(2)},${y.toFixed(2)})${page.looks[kind]?.marker === "v" ? " rotate(180)" : ""}`;
}

/** Where an event is drawn. @param {Entry} entry @returns {{entry: Entry, x: number, y: number, wall: number}[]} */
function marksOf(entry) {
  const family = familyById.get(entry.branch),
    x = entry.parameters[state.x] ?? family?.columns[state.x]?.[entry.row];
  if (!family || x === undefined) return [];
  if (state.y !== "velocity") {
    return linesOf(family, state.y)
      .filter((line) => line.values)
      .map((line) => ({ entry, x, y: line.values[entry.row], wall: -1 }))
      .filter((mark) => Number.isFinite(mark.y));
  }
  const marks = entry.impacts.map((impact) => ({
    entry,
    x,
    y: impact.velocity,
    wall: page.walls.indexOf(impact.wall),
  }));
  if (page.looks[entry.kind]?.touching && entry.wall)
    marks.push({ entry, x, y: 0, wall: page.walls.indexOf(entry.wall) });
  return marks.filter((mark) => wallShown(mark.wall));
}

/** @param {Selected} layer */
function drawEvents(layer) {
  const marks = shownEntries()
    .sort((a, b) => Number(b.ghost) - Number(a.ghost))
    .flatMap(marksOf);
  for (const { x, y } of marks) cover(drawn.x(x), drawn.y(y), 1);
  const passing = new Set(filtered().map((entry) => entry.id));
  layer
    .selectAll("path")
    .data(marks)
    .join("path")
    .attr("d", ({ entry }) => marker(entry.kind))
    .attr(
      "class",
      ({ entry, wall }) =>
        `event ${wallClass(wall)}${entry.ghost ? " ghost" : ""}${passing.has(entry.id) ? "" : " faint"}`,
    )
    .attr("data-entry", ({ entry }) => entry.id)
    .attr("transform", ({ entry, x, y }) => placed(entry.kind, drawn.x(x), drawn.y(y)));
}

/** Where the chosen orbit lies. @param {{family: Family, row: number, entry: Entry | null}} place @returns {[number, number][]} */
function spotsOf({ family, row, entry }) {
  if (entry) return marksOf(entry).map(({ x, y }) => [x, y]);
  const x = family.columns[state.x]?.[row];
  if (x === undefined) return [];
  if (family.swept) {
    if (state.y !== "velocity") return [];
    return Array.from(family.velocities.slice(family.starts[row], family.starts[row + 1]), (v) => [x, v]);
  }
  return linesOf(family, state.y)
    .filter((line) => line.values && wallShown(line.wall))
    .map((line) => [x, line.values[row]]);
}

/** @param {Selected} layer */
function drawSelection(layer) {
  const place = placeOf(state.at),
    here = place && memberOf(place.family) === state.member ? spotsOf(place) : [];
  layer
    .selectAll("circle")
    .data(here)
    .join("circle")
    .attr("class", "selection")
    .attr("r", 8)
    .attr("cx", ([x]) => drawn.x(x))
    .attr("cy", ([, y]) => drawn.y(y));
}
