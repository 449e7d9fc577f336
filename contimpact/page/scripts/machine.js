// The machine as it is: bodies in a row, in a container or on a pendulum, with their springs and walls, to move as the
// orbit does. Displacements are to scale, bodies have a size in pixels.

/**
 * A length: pixels, and units of displacement that the picture's scale turns into some.
 * @typedef {[number, number]} Length
 */
/** @typedef {{x: number, v: number}[]} States */
/** @typedef {{moved: (states: States) => void}} Machine */

const TALL = 40,
  BALL = 11,
  POST = 34,
  HATCHES = 6,
  LANE_OF_BODY = 64;

/** Draw the machine of an orbit; null where it has no picture. @param {Motion} motion @param {Family} family @param {number} row @returns {Machine | null} */
function drawMachine(motion, family, row) {
  const { machine } = page,
    svg = d3.select("#machine");
  /** @type {HTMLElement} */ (element("machine").parentElement).hidden = machine === null;
  if (!machine) return null;
  const width = sized(svg, PANEL),
    given = machine.direction,
    angle = typeof given === "number" ? given : (family.columns[given]?.[row] ?? 0);
  svg.selectAll("*").remove();
  svg.attr("aria-label", `The machine, moving as the orbit ${titleOf(family)} does`);
  const within = machine.contained.some(([, carrier]) => carrier < 0);
  element("machine-caption").textContent = `the machine${within ? ", seen from its container" : ""}`;
  return machine.turning ? pendulum(svg, motion, width) : rows(svg, motion, machine, width, angle);
}

/** @typedef {{name: string, place: number, i: number, side: number, soft: boolean, rigid: boolean, look: string}} Stop */

/** The walls of a coordinate, one for those that share a place. @param {Motion} motion @param {number} i @returns {Stop[]} */
function stopsOf(motion, i) {
  const guards = page.machine?.guards ?? {};
  return wallsTogether(motion)
    .filter(({ coordinate }) => coordinate === i)
    .map(({ names, place, look }) => {
      const first = names.map((name) => guards[name]).find(({ soft, rigid }) => soft || rigid);
      return { name: names.join(", "), place, i, look, ...(first ?? guards[names[0]]) };
    });
}

/**
 * Where bodies and walls of a row are.
 * @typedef {{carrier: Map<number, number>, lanes: boolean, met: Set<number>, wide: Length[], left: Length[], high: number[], pixels: number}} Row
 */

/** Where everything is along the row, so that nothing meets but what does. @param {Motion} motion @param {Geometry} machine @returns {Row} */
function rowOf(motion, machine) {
  const count = motion.coordinates.length,
    carrier = new Map(machine.contained),
    meeting = Object.entries(machine.guards).filter(([, { row }]) => row.filter(Boolean).length === 2),
    lanes = count > 1 && ![machine.springs, machine.contained, meeting].some(({ length }) => length);
  const spans = d3.range(count).map((i) => {
    const values = motion.flights.flatMap(({ x }) => x[i].filter(Number.isFinite));
    return d3.extent([...values, ...stopsOf(motion, i).map(({ place }) => place)]);
  });
  const low = spans.map(([least]) => least ?? 0),
    high = spans.map(([, most]) => most ?? 0),
    far = machine.springs.some(([, b]) => b === count) ? POST : 0;
  /** A container is as wide as its walls are apart. @type {Length[]} */
  const wide = spans.map((_, i) => {
    const inner = machine.contained.find(([, outer]) => outer === i)?.[0];
    if (inner === undefined) return ballLike(i) ? [2 * BALL, 0] : [TALL, 0];
    const [least, most] = d3.extent(stopsOf(motion, inner), ({ place }) => place);
    return [2 * BALL + 12, (most ?? 0) - (least ?? 0)];
  });
  /** @type {Length[]} */
  const left = [];
  /** @type {Length} */
  let end = [machine.springs.some(([a]) => a < 0) ? POST + 8 : 10, 0];
  let pixels = 0;
  for (const i of d3.range(count)) {
    const outer = carrier.get(i) ?? -1;
    if (outer >= 0) {
      const lowest = d3.min(stopsOf(motion, i), ({ place }) => place) ?? 0;
      left[i] = [left[outer][0] + 6, left[outer][1] - lowest];
      continue;
    }
    const met = meeting.find(([, { row }]) => row[i] && row.slice(0, i).some(Boolean));
    if (lanes) left[i] = [10, -(d3.min(low) ?? 0)];
    else if (met) {
      const [name, { row }] = met,
        other = row.findIndex(Boolean);
      left[i] = [
        left[other][0] + wide[other][0],
        left[other][1] + Math.abs(motion.places[name] / row[other]),
      ];
    } else left[i] = [end[0], end[1] - low[i]];
    const after = stopsOf(motion, i).some(({ soft }) => soft) ? POST + 8 : 16;
    pixels = Math.max(pixels, left[i][0] + wide[i][0] + after + far);
    end = [left[i][0] + wide[i][0] + POST + 8, left[i][1] + wide[i][1] + high[i]];
  }
  const met = new Set(meeting.map(([, { row }]) => row.findIndex(Boolean)));
  return { carrier, lanes, met, wide, left, high, pixels };
}

/** Bodies that move along a line. @param {Selected} svg @param {Motion} motion @param {Geometry} machine @param {number} width @param {number} angle @returns {Machine} */
function rows(svg, motion, machine, width, angle) {
  const { carrier, lanes, met, wide, left, high, pixels } = rowOf(motion, machine),
    count = left.length,
    tall = lanes ? LANE_OF_BODY * count : TALL + 40,
    [cos, sin] = [Math.abs(Math.cos(angle)), Math.abs(Math.sin(angle))],
    room = Math.min(
      (width - 12 - tall * sin) / Math.max(cos, 1e-9),
      (PANEL - 12 - tall * cos) / Math.max(sin, 1e-9),
    ),
    units = d3.max(left, ([, part], i) => part + wide[i][1] + high[i]) ?? 0,
    scale = Math.max(0, room - pixels) / (units || 1),
    long = pixels + scale * units,
    at = (/** @type {Length} */ [px, part]) => px + scale * part,
    level = (/** @type {number} */ i) => (lanes ? LANE_OF_BODY * (i - (count - 1) / 2) : 0);
  const line = svg
      .append("g")
      .attr(
        "transform",
        `translate(${width / 2},${PANEL / 2}) rotate(${(angle * 180) / Math.PI}) translate(${-long / 2},0)`,
      ),
    still = line.append("g"),
    things = line.append("g");
  const faces = d3.range(count).flatMap((i) =>
    stopsOf(motion, i).map((stop) => {
      const beyond = stop.side > 0 ? wide[i][0] : 0;
      return {
        ...stop,
        face: at([left[i][0] + beyond, left[i][1] + stop.place]),
        across: level(i),
        inside: (carrier.get(i) ?? -1) >= 0,
      };
    }),
  );
  const tube = machine.contained.some(([, outer]) => outer < 0);
  if (tube) drawTube(still, faces);
  else if (!angle) drawGround(still, machine, long, d3.range(lanes ? count : 1).map(level), count);
  for (const { i, face, across, side, rigid, soft, look } of faces.filter(({ inside }) => !inside)) {
    const below = machine.springs.some(([a, b]) => (side > 0 ? a : b) === i) || (side > 0 && met.has(i));
    if (soft)
      still
        .append("path")
        .attr("class", "ground")
        .attr("d", hatched(face + POST, across, 1, TALL / 2));
    else drawStop(still, face, across, side, rigid, look, below);
  }
  const bodies = d3.range(count).map((i) => {
    const body = things.append("g").attr("class", `body ${coordinateClass(i)}`),
      own = faces.filter(({ i: one, inside }) => inside && carrier.get(one) === i);
    if (ballLike(i))
      body.append("circle").attr("class", "ball").attr("r", BALL).attr("cx", BALL).attr("cy", level(i));
    else drawBody(body, at(wide[i]), level(i), count > 1 ? motion.coordinates[i] : "", own);
    return body;
  });
  const springs = machine.springs.map(([a, b]) => ({
    a,
    b,
    path: things.append("path").attr("class", "spring"),
  }));
  const plates = faces
    .filter(({ soft }) => soft)
    .map((stop) => ({
      ...stop,
      plate: things.append("path").attr("class", `stop ${stop.look}`),
      pushed: things.append("path").attr("class", "spring"),
    }));
  nameStops(
    svg,
    faces.filter(({ inside }) => !inside),
    ({ face, across, side, soft }) => {
      const along = face + (soft ? POST / 2 : 9 * side) - long / 2,
        up = across - TALL / 2 - (tube ? 0 : 13);
      return tube
        ? [width / 2 + (along + 8 * side) * Math.cos(angle), PANEL / 2 + (along + 8 * side) * Math.sin(angle)]
        : [
            width / 2 + along * Math.cos(angle) - up * Math.sin(angle),
            PANEL / 2 + along * Math.sin(angle) + up * Math.cos(angle),
          ];
    },
  );
  if (angle) drawGravity(svg, angle > 0 ? width - 24 : 16);
  return {
    moved(states) {
      const places = states.map(({ x }, i) => {
        const outer = carrier.get(i) ?? -1;
        return at([left[i][0], left[i][1] + x + (outer >= 0 ? states[outer].x : 0)]);
      });
      bodies.forEach((body, i) => {
        const there = Number.isFinite(places[i]);
        body.attr("visibility", there ? null : "hidden");
        if (there) body.attr("transform", `translate(${places[i]},0)`);
      });
      for (const { a, b, path } of springs) {
        const from = a < 0 ? 6 : places[a] + at(wide[a]),
          to = b === count ? long - 6 : places[b];
        path.attr("d", coil(from, to, -TALL / 4));
      }
      for (const { i, face, place, across, plate, pushed } of plates) {
        const now = face + scale * Math.max(0, states[i].x - place);
        plate.attr("d", `M${now},${across - TALL / 2}v${TALL}`);
        pushed.attr("d", coil(now, face + POST, across));
      }
    },
  };
}

/** A block with the name of its coordinate; or a container, with its walls. @param {Selected} body @param {number} wide @param {number} level @param {string} name @param {Stop[]} walls */
function drawBody(body, wide, level, name, walls) {
  const tall = walls.length ? TALL + 14 : TALL;
  body
    .append("rect")
    .attr("class", "solid")
    .attr("width", wide)
    .attr("height", tall)
    .attr("y", level - tall / 2)
    .attr("rx", 2);
  for (const { name: wall, side, look } of walls) {
    const at = side > 0 ? wide - 3 : 3;
    body
      .append("path")
      .attr("class", `stop ${look}`)
      .attr("d", `M${at},${level - 14}v28`);
    body
      .append("text")
      .attr("class", `wall-name ${look}`)
      .attr("text-anchor", "middle")
      .attr("x", at)
      .attr("y", level - tall / 2 - 5)
      .text(wall);
  }
  if (!walls.length)
    body
      .append("text")
      .attr("class", "coordinate-name")
      .attr("text-anchor", "middle")
      .attr("x", wide / 2)
      .attr("y", level + 4)
      .text(name && symbol(name));
}

/** The names of walls, upright. @template {Stop} S @param {Selected} svg @param {S[]} stops @param {(stop: S) => number[]} place */
function nameStops(svg, stops, place) {
  svg
    .append("g")
    .selectAll("text")
    .data(stops)
    .join("text")
    .attr("class", ({ look }) => `wall-name ${look}`)
    .attr("text-anchor", "middle")
    .attr("x", (stop) => place(stop)[0])
    .attr("y", (stop) => place(stop)[1] + 4)
    .text(({ name }) => name);
}

/** Whether a body is a ball: it flies freely. @param {number} i */
function ballLike(i) {
  const machine = page.machine;
  if (!machine) return false;
  return machine.contained.some(([inner]) => inner === i) || machine.direction !== 0;
}

/** A coil between two places. @param {number} from @param {number} to @param {number} across */
function coil(from, to, across) {
  const ends = Math.min(6, Math.max(0, (to - from) / 8)),
    step = (to - from - 2 * ends) / 12,
    turns = d3.range(12).map((k) => `L${from + ends + (k + 0.5) * step},${across + (k % 2 ? 4.5 : -4.5)}`);
  return `M${from},${across}H${from + ends}${turns.join("")}L${to - ends},${across}H${to}`;
}

/** A line across with hatches behind it. @param {number} at @param {number} across @param {number} side @param {number} half */
function hatched(at, across, side, half) {
  const steps = d3.range(-half + 2, half, HATCHES);
  return (
    `M${at},${across - half}v${2 * half}` +
    steps.map((y) => `M${at},${across + y + 3}l${5 * side},-5`).join("")
  );
}

/** A wall, rigid or only passed; a low one where a spring passes over it.
 * @param {Selected} layer @param {number} face @param {number} across @param {number} side @param {boolean} rigid @param {string} look @param {boolean} below */
function drawStop(layer, face, across, side, rigid, look, below) {
  const half = below ? 8 : TALL / 2 + 3,
    middle = below ? across + 8 : across;
  layer
    .append("path")
    .attr("class", `${rigid ? "stop" : "passing"} ${look}`)
    .attr("d", `M${face + (rigid ? 1.7 * side : 0)},${middle - half}v${2 * half}`);
  if (rigid)
    layer
      .append("path")
      .attr("class", `hatch ${look}`)
      .attr("d", hatched(face + 3 * side, middle, side, half));
}

/** Floors, and what springs are fixed to. @param {Selected} layer @param {Geometry} machine @param {number} long @param {number[]} levels @param {number} count */
function drawGround(layer, machine, long, levels, count) {
  const half = TALL / 2 + 1,
    floor = machine.contained.length ? half + 7 : half,
    parts = levels.map((level) => `M0,${level + floor}H${long}`);
  if (machine.springs.some(([a]) => a < 0)) parts.push(hatched(6, 0, -1, half));
  if (machine.springs.some(([, b]) => b === count)) parts.push(hatched(long - 6, 0, 1, half));
  layer.append("path").attr("class", "ground").attr("d", parts.join(""));
}

/** The sides of the container that displacements are measured from. @param {Selected} layer @param {{face: number}[]} faces */
function drawTube(layer, faces) {
  const [from, to] = d3.extent(faces, ({ face }) => face),
    half = TALL / 2 + 3;
  layer.append("path").attr("class", "ground").attr("d", `M${from},${-half}H${to}M${from},${half}H${to}`);
}

/** Which way is down. @param {Selected} svg @param {number} at */
function drawGravity(svg, at) {
  svg
    .append("path")
    .attr("class", "ground")
    .attr("d", `M${at},12V38M${at - 4},31L${at},38L${at + 4},31`);
  svg
    .append("text")
    .attr("class", "name")
    .attr("x", at + 7)
    .attr("y", 30)
    .attr("font-style", "italic")
    .text("g");
}

/** A pendulum and its stops. @param {Selected} svg @param {Motion} motion @param {number} width @returns {Machine} */
function pendulum(svg, motion, width) {
  const middle = [width / 2, PANEL / 2],
    rod = Math.min(width, PANEL) / 2 - 26,
    own = Math.asin(BALL / rod);
  const place = (/** @type {number} */ angle, /** @type {number} */ far) => [
    middle[0] + far * Math.sin(angle),
    middle[1] + far * Math.cos(angle),
  ];
  svg.append("circle").attr("class", "frame").attr("r", rod).attr("cx", middle[0]).attr("cy", middle[1]);
  svg
    .append("path")
    .attr("class", "ground")
    .attr("stroke-dasharray", "2 3")
    .attr("d", `M${middle}V${middle[1] + rod}`);
  const stops = stopsOf(motion, 0),
    face = (/** @type {Stop} */ { place: at, side }) => at + side * own;
  for (const stop of stops)
    svg
      .append("path")
      .attr("class", `stop ${stop.look}`)
      .attr("d", `M${place(face(stop), rod - 16)}L${place(face(stop), rod + 14)}`);
  nameStops(svg, stops, (stop) => place(face(stop) + (stop.side * 12) / rod, rod + 14));
  const arm = svg.append("path").attr("class", "ground"),
    bob = svg.append("circle").attr("class", "ball coordinate0").attr("r", BALL);
  svg
    .append("circle")
    .attr("class", "before nowall")
    .attr("r", 3)
    .attr("cx", middle[0])
    .attr("cy", middle[1]);
  drawGravity(svg, 16);
  return {
    moved([{ x }]) {
      if (!Number.isFinite(x)) return;
      const [px, py] = place(x, rod);
      arm.attr("d", `M${middle}L${px},${py}`);
      bob.attr("cx", px).attr("cy", py);
    },
  };
}
