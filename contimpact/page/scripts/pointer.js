// The pointer over the diagram: what is nearest, what is said of it, zoom and choice.

/** How near to a point the pointer has to be, in pixels. */
const NEAREST = 28;

/**
 * What is nearest to a place of the picture: an event if one is near, else a point.
 * @param {number} px
 * @param {number} py
 * @returns {{at: string, x: number, y: number} | null}
 */
function nearest(px, py) {
  let found = null,
    least = 10;
  for (const mark of shownEntries().flatMap(marksOf)) {
    const x = drawn.x(mark.x),
      y = drawn.y(mark.y),
      apart = Math.hypot(x - px, y - py);
    if (apart < least) [found, least] = [{ at: mark.entry.id, x, y }, apart];
  }
  if (found) return found;
  const [ax, bx] = affine(drawn.x),
    [ay, by] = affine(drawn.y);
  let best = NEAREST * NEAREST;
  visitPoints((family, row, _k, place, value) => {
    const x = ax * place + bx,
      y = ay * value + by,
      apart = (x - px) ** 2 + (y - py) ** 2;
    if (apart < best) [found, best] = [{ at: `${family.id}:${row}`, x, y }, apart];
  });
  return found;
}

/** What is said of a point beside the pointer. @param {string} at */
function hoverText(at) {
  const place = placeOf(at);
  if (!place) return "";
  const { family, row, entry } = place,
    from = family.starts[row],
    to = Math.min(family.starts[row + 1], from + 6);
  const speeds = Array.from(
    { length: to - from },
    (_, k) => `${page.walls[family.walls[from + k]]} ${shown(family.velocities[from + k], 6)}`,
  );
  const lines = [
    (entry ? `${entry.label} (${entry.id}) on ` : "") + titleOf(family),
    valueText(family, row),
    `velocities: ${speeds.join(", ")}${to < family.starts[row + 1] ? ", ..." : ""}`,
  ];
  lines.push(
    `multipliers: ${multipliersAt(family, row)
      .map(([re, im]) => complex(re, im))
      .join("; ")}`,
  );
  if (Number.isFinite(family.columns.smallest_gap?.[row]))
    lines.push(`smallest gap: ${shown(family.columns.smallest_gap[row], 6)}`);
  const margin = marginText(family, row);
  if (margin) lines.push(`margin: ${margin}`);
  lines.push(stateOf(family, row, entry));
  return lines.join(" \u00b7 ");
}

/** Show a text below a picture, instead of the help that stands there. @param {string} id @param {string} help @param {string} text */
function showHover(id, help, text) {
  element(id).hidden = !text;
  element(id).textContent = text;
  element(help).hidden = Boolean(text);
}

/** @param {PointerEvent | null} event */
function pointAt(event) {
  const [px, py] = event ? d3.pointer(event, diagram.node()) : [-1, -1],
    { box } = drawn;
  const inside = px >= box.left && px <= box.right && py >= box.top && py <= box.bottom;
  const found = inside ? nearest(px, py) : null;
  diagram
    .select("g.pointer")
    .selectAll("circle")
    .data(found ? [found] : [])
    .join("circle")
    .attr("class", "pointed")
    .attr("r", 6)
    .attr("cx", (spot) => spot.x)
    .attr("cy", (spot) => spot.y);
  showHover("hover", "keys", found ? hoverText(found.at) : "");
  return found;
}

/** @param {Limits} limits */
function zoomTo(limits) {
  change({ xlim: limits.x, ylim: limits.y });
}

zoomable(diagram, () => drawn, zoomTo);
let asked = 0;
diagram
  .on("pointermove", (event) => {
    cancelAnimationFrame(asked);
    asked = event.buttons
      ? 0
      : requestAnimationFrame(() => {
          pointAt(event);
        });
  })
  .on("pointerleave", () => pointAt(null))
  .on("click", (event) => {
    const found = event.defaultPrevented || event.shiftKey ? null : pointAt(event);
    if (found) pick(found.at);
  });
