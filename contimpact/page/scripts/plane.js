// Curves of bifurcations in two parameters; a click opens the diagram at the nearest value that was computed.

const plane = d3.select("#plane");
/** @type {{box: Box, limits: Limits, x: Linear, y: Linear}} */
let planeDrawn = { ...drawn };

/** @type {{curve: Curve, columns: Record<string, Numbers>, ghost: Numbers, made: Record<string, Numbers>}[]} */
const curves = page.curves.map((curve) => ({
  curve,
  columns: unpackedAll(curve.columns, curve.rows),
  ghost: unpacked(curve.ghost, curve.rows),
  made: {},
}));

/** Curves of one bifurcation of an orbit have one look. @param {Curve} curve */
function keyOf(curve) {
  return [curve.kind, curve.label, curve.notation].join("\0");
}

const keys = [...new Set(page.curves.map(keyOf))];

/** The kind's colour; a second bifurcation of a kind is black, further ones are grey. @param {string} key */
function lookOf(key) {
  const kind = key.split("\0")[0],
    place = keys.filter((other) => other.split("\0")[0] === kind).indexOf(key);
  return {
    colour: place === 0 ? (page.looks[kind]?.colour ?? null) : null,
    name: place === 1 ? "plain" : place > 1 ? "further" : "own",
  };
}

/** The members of the diagram that belong to a panel, with their value of the second parameter. @param {Panel} panel */
function computedIn(panel) {
  return page.members
    .map((member, place) => ({
      place,
      value: member.fixed[panel.across],
      fixed: member.fixed,
    }))
    .filter(
      ({ value, fixed }) =>
        value !== undefined &&
        Object.entries(panel.fixed).every(([name, own]) => (fixed[name] ?? page.fixed[name]) === own),
    );
}

/** @returns {Limits} */
function planeHome() {
  const panel = page.panels[state.panel],
    own = panel.curves.map((place) => curves[place].columns);
  const extent = (/** @type {string} */ name) =>
    widened(
      [
        d3.min(own, (columns) => d3.min(columns[name])) ?? 0,
        d3.max(own, (columns) => d3.max(columns[name])) ?? 1,
      ],
      0.04,
    );
  return { x: extent(panel.across), y: extent(panel.along) };
}

/** Draw the view of curves. */
function drawPlane() {
  const panel = page.panels[state.panel];
  if (!panel) return;
  const width = sized(plane, panel.areas.length ? 570 : 520),
    box = { left: 62, right: width - 20, top: 16, bottom: 430 },
    given = state.plane;
  /** @type {Limits} */
  const limits = given ? { x: [given[0], given[1]], y: [given[2], given[3]] } : planeHome();
  const x = d3.scaleLinear(limits.x, [box.left, box.right]),
    y = d3.scaleLinear(limits.y, [box.bottom, box.top]);
  planeDrawn = { box, limits, x, y };
  const inside = drawFrame(plane, box, { x, y }, { x: withUnit(panel.across), y: withUnit(panel.along) });
  drawAreas(group(inside, "areas"), panel);
  drawRegions(group(inside, "regions"), panel);
  drawCurves(group(inside, "curves"), panel);
  drawPoints(group(inside, "points"), panel);
  group(inside, "pointer");
  drawComputed(group(plane, "values"), panel);
  drawCurveKey(group(plane, "key"), panel);
  drawAreaKey(group(plane, "tints"), panel, 518);
  plane.attr(
    "aria-label",
    `Curves of bifurcations: ${withUnit(panel.along)} against ${withUnit(panel.across)}, ${valuesText(panel.fixed)}`,
  );
}

/** @param {Selected} layer @param {Panel} panel */
function drawCurves(layer, panel) {
  const lines = panel.curves
    .flatMap((place) => {
      const { curve, columns, ghost, made } = curves[place],
        pens = [d3.pathRound(2), d3.pathRound(2)];
      const slope = (/** @type {string} */ name) => (made[name] ??= slopes(columns.arclength, columns[name]));
      draw(
        {
          length: columns.arclength,
          x: columns[panel.across],
          y: columns[panel.along],
          dx: slope(panel.across),
          dy: slope(panel.along),
          status: ghost,
        },
        planeDrawn,
        pens,
      );
      return pens.map((pen, status) => ({
        curve,
        d: pen.toString(),
        name: status ? "ghost" : "",
        look: lookOf(keyOf(curve)),
      }));
    })
    .filter(({ d }) => d);
  layer
    .selectAll("path")
    .data(lines)
    .join("path")
    .attr("class", ({ name, look }) => `curve ${look.name} ${name}`)
    .attr("stroke", ({ look }) => look.colour)
    .attr("data-curve", ({ curve }) => curve.id)
    .attr("d", ({ d }) => d);
}

/** Points of codimension two, with their kinds. @param {Selected} layer @param {Panel} panel */
function drawPoints(layer, panel) {
  const all = panel.curves
    .flatMap((place) => curves[place].curve.points)
    .map((point) => ({
      ...point,
      x: planeDrawn.x(point.parameters[panel.across]),
      y: planeDrawn.y(point.parameters[panel.along]),
    }));
  // a crossing of two curves is found on each of them
  const points = all.filter((point, k) =>
    all.slice(0, k).every((other) => Math.hypot(other.x - point.x, other.y - point.y) > 3),
  );
  const dots = layer
    .selectAll("circle")
    .data(points)
    .join("circle")
    .attr("class", "point")
    .attr("r", 4.5)
    .attr("cx", ({ x }) => x)
    .attr("cy", ({ y }) => y);
  dots
    .selectAll("title")
    .data((point) => [point])
    .join("title")
    .text(({ kind, changes }) => `${kind}: ${changes}`);
  layer
    .selectAll("text")
    .data(points)
    .join("text")
    .attr("class", "label")
    .attr("x", ({ x }) => x + 7)
    .attr("y", ({ y }) => y - 5)
    .text(({ kind }) => kind);
}

/** What comes first, as bands along the lower edge, where no areas tell more. @param {Selected} layer @param {Panel} panel */
function drawRegions(layer, panel) {
  const { x, box } = planeDrawn;
  const bands = (panel.areas.length ? [] : panel.regions).map((region) => {
    const curve = page.curves.find((one) => one.label === region.first && one.notation === region.notation);
    return {
      region,
      look: curve ? lookOf(keyOf(curve)) : { colour: null, name: "further" },
      lane: region.lane,
    };
  });
  const rects = layer
    .selectAll("rect")
    .data(bands)
    .join("rect")
    .attr("class", ({ region }) => `region${region.said ? " unchecked" : ""}`)
    .attr("x", ({ region }) => x(region.low))
    .attr("width", ({ region }) => Math.max(0, x(region.high) - x(region.low)))
    .attr("y", ({ lane }) => box.bottom - 13 - 14 * lane)
    .attr("height", 12)
    .attr("fill", ({ look }) => look.colour ?? "gray");
  rects
    .selectAll("title")
    .data((band) => [band])
    .join("title")
    .text(
      ({ region }) =>
        `${region.notation}${region.branch ? ` (${region.branch})` : ""}: ${region.first} first from ${shown(region.low, 6)} to ${shown(region.high, 6)}${region.said ? ` (${region.said})` : ""}`,
    );
}

/** Values at which branches were computed, below the axis, and as buttons. @param {Selected} layer @param {Panel} panel */
function drawComputed(layer, panel) {
  const { x, box } = planeDrawn,
    values = computedIn(panel);
  layer
    .selectAll("path")
    .data(values.filter(({ value }) => x(value) >= box.left && x(value) <= box.right))
    .join("path")
    .attr("class", ({ place }) => `computed${place === state.member ? " here" : ""}`)
    .attr("d", d3.symbol(d3.symbolTriangle, 50)())
    .attr("transform", ({ value }) => `translate(${x(value)},${box.bottom + 27})`);
  const buttons = values.map(({ place, value }) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `${symbol(panel.across)} = ${ofPi(value)}`;
    button.addEventListener("click", () => openMember(place));
    return button;
  });
  element("plane-diagrams").replaceChildren(
    ...(values.length ? ["diagrams at", ...buttons] : ["no branches were computed here"]),
  );
}

/** @param {Selected} layer @param {Panel} panel */
function drawCurveKey(layer, panel) {
  const own = [...new Set(panel.curves.map((place) => keyOf(page.curves[place])))];
  const several = new Set(own.map((key) => key.split("\0")[2])).size > 1;
  let at = planeDrawn.box.left;
  const items = own.map((key) => {
    const [, label, notation] = key.split("\0"),
      name = label + (several ? ` (${notation})` : ""),
      here = at;
    at += 40 + 7.2 * name.length;
    return { name, look: lookOf(key), at: here, ghost: false };
  });
  items.push({
    name: "dotted: ghost",
    look: { colour: null, name: "plain" },
    at,
    ghost: true,
  });
  layer
    .selectAll("path")
    .data(items)
    .join("path")
    .attr("class", ({ look, ghost }) => `curve ${look.name}${ghost ? " ghost" : ""}`)
    .attr("stroke", ({ look }) => look.colour)
    .attr("d", "M0,0H24")
    .attr("transform", (item) => `translate(${item.at},490)`);
  layer
    .selectAll("text")
    .data(items)
    .join("text")
    .attr("class", "label")
    .attr("x", (item) => item.at + 29)
    .attr("y", 494)
    .text(({ name }) => name);
}

/** The tables of points of codimension two and of areas. */
function drawPlaneTables() {
  const panel = page.panels[state.panel];
  const rows = (panel?.curves ?? []).flatMap((place) =>
    page.curves[place].points.map((point) => [
      point.kind,
      page.curves[place].label,
      shown(point.parameters[panel.across]),
      shown(point.parameters[panel.along]),
      point.changes,
    ]),
  );
  const head = ["point", "on", withUnit(panel?.across ?? ""), withUnit(panel?.along ?? ""), "what changes"];
  const areas = panel ? areaRows(panel) : [],
    areaHead = ["area", "stable orbits", "of the rectangle", "doubts"];
  element("plane-points").replaceChildren(
    ...(rows.length ? [tableOf([head, ...rows], "Points of codimension two")] : []),
    ...(areas.length ? [tableOf([areaHead, ...areas], "Areas")] : []),
  );
}

/** Open the diagram of a member. @param {number} member */
function openMember(member) {
  const at = placeOf(state.at),
    kept = at && memberOf(at.family) === member;
  change({
    view: "diagram",
    member,
    xlim: null,
    ylim: null,
    at: kept ? state.at : "",
  });
}

/** The curve's point nearest to a place. @param {number} px @param {number} py */
function nearestOnCurves(px, py) {
  const panel = page.panels[state.panel];
  let found = null,
    least = NEAREST;
  for (const place of panel.curves) {
    const { curve, columns, ghost } = curves[place];
    for (let row = 0; row < curve.rows; row++) {
      const x = planeDrawn.x(columns[panel.across][row]),
        y = planeDrawn.y(columns[panel.along][row]),
        apartBy = Math.hypot(x - px, y - py);
      if (apartBy < least) [found, least] = [{ curve, row, x, y, ghost: ghost[row], columns }, apartBy];
    }
  }
  return found;
}

/** The member whose value is nearest to a place. @param {number} px */
function nearestComputed(px) {
  const values = computedIn(page.panels[state.panel]),
    wanted = planeDrawn.x.invert(px);
  return d3.least(values, ({ value }) => Math.abs(value - wanted));
}

/** What is said of a place: the curve there, and what a click opens. @param {number} px @param {number} py */
function planeText(px, py) {
  const panel = page.panels[state.panel],
    found = nearestOnCurves(px, py),
    member = nearestComputed(px),
    lines = [];
  if (found) {
    const { curve, columns, row, ghost } = found;
    const names = [...new Set([panel.across, panel.along, ...curve.parameters])];
    lines.push(`${curve.label} of ${curve.notation}, ${curve.id}${ghost ? ", ghost" : ""}`);
    lines.push(...names.map((name) => `${symbol(name)} = ${shown(columns[name]?.[row])}`));
  }
  const area = areaAt(panel, planeDrawn.x.invert(px), planeDrawn.y.invert(py));
  if (area) lines.push(`${area.id}: ${area.says}`);
  if (member) lines.push(`click: the diagram at ${symbol(panel.across)} = ${ofPi(member.value)}`);
  return { found, text: lines.join("\n") };
}

plane
  .on("pointermove", (event) => {
    const [px, py] = d3.pointer(event, plane.node()),
      { box } = planeDrawn;
    const inside = px >= box.left && px <= box.right && py >= box.top && py <= box.bottom;
    const { found, text } = inside && !event.buttons ? planeText(px, py) : { found: null, text: "" };
    group(group(plane, "inside"), "pointer")
      .selectAll("circle")
      .data(found ? [found] : [])
      .join("circle")
      .attr("class", "pointed")
      .attr("r", 6)
      .attr("cx", (spot) => spot.x)
      .attr("cy", (spot) => spot.y);
    showHover("plane-hover", text, found?.x ?? px, found?.y ?? py, box.right);
  })
  .on("pointerleave", () => showHover("plane-hover", "", 0, 0, 0))
  .on("click", (event) => {
    if (event.defaultPrevented || event.shiftKey) return;
    const member = nearestComputed(d3.pointer(event, plane.node())[0]);
    if (member) openMember(member.place);
  });

const zoomPlane = (/** @type {Limits} */ limits) => change({ plane: [...limits.x, ...limits.y] });
if (page.curves.length) zoomable(plane, () => planeDrawn, zoomPlane);
element("plane-in").addEventListener("click", () => zoomPlane(scaled(planeDrawn.limits, 0.5)));
element("plane-out").addEventListener("click", () => zoomPlane(scaled(planeDrawn.limits, 2)));
element("plane-all").addEventListener("click", () => change({ plane: null }));
element("panel").addEventListener("change", (event) =>
  change({
    panel: Number(/** @type {HTMLSelectElement} */ (event.target).value),
    plane: null,
  }),
);
