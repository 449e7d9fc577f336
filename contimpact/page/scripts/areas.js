// Areas of two parameters in which the same stable orbits end in the same way, tinted under the curves.

/** @typedef {{text: string, parts: Parts | null, behind: string, name: string, fill: string}} Tint */

/** The key to the tint of an area: what ends its first orbit. @param {Panel} panel @param {Area} area @returns {Tint} */
function tintOf(panel, area) {
  const [{ ends, notation }] = area.orbits,
    several = new Set(panel.areas.flatMap(({ orbits }) => orbits.map((orbit) => orbit.notation))).size > 1;
  const parts = page.keys.find((key) => key.label === ends && key.notation === notation)?.parts ?? null,
    behind = several ? ` (${notation})` : "";
  return {
    text: ends ? `stable until ${parts ? "" : ends}` : "stable throughout",
    parts,
    behind,
    name: ends ? "area" : "area throughout",
    fill: colourOf(ends, notation),
  };
}

/** Crossed lines over areas with several stable orbits. */
function drawCrosses() {
  plane
    .selectAll("pattern")
    .data([0])
    .join("pattern")
    .attr("id", "crosses")
    .attr("width", 7)
    .attr("height", 7)
    .attr("patternUnits", "userSpaceOnUse")
    .selectAll("path")
    .data([0])
    .join("path")
    .attr("class", "crosses")
    .attr("d", "M0,0L7,7M7,0L0,7");
}

/** @param {Selected} layer @param {Panel} panel */
function drawAreas(layer, panel) {
  const { x, y } = planeDrawn,
    pen = d3.line(
      ([across]) => x(across),
      ([, along]) => y(along),
    );
  const shapes = panel.areas.flatMap((area) => {
    const shape = { area, d: area.polygon.map((ring) => `${pen(ring)}Z`).join("") },
      tinted = { ...tintOf(panel, area), ...shape };
    return area.orbits.length > 1 ? [tinted, { ...shape, name: "", fill: "url(#crosses)" }] : [tinted];
  });
  if (panel.areas.some(({ orbits }) => orbits.length > 1)) drawCrosses();
  layer
    .selectAll("path")
    .data(shapes)
    .join("path")
    .attr("class", ({ name }) => name)
    .attr("fill", ({ fill }) => fill)
    .attr("fill-rule", "evenodd")
    .attr("data-area", ({ area }) => area.id)
    .attr("d", ({ d }) => d);
}

/** The keys to the tints, each once, in rows. @param {Panel} panel @param {number} left @param {number} right */
function areaKey(panel, left, right) {
  const tints = panel.areas.map((area) => tintOf(panel, area)),
    keys = d3
      .groups(tints, ({ text, parts, behind }) => JSON.stringify([text, parts, behind]))
      .map(([, [first]]) => first);
  if (panel.areas.some(({ orbits }) => orbits.length > 1))
    keys.push({
      text: "several stable orbits",
      parts: null,
      behind: "",
      name: "",
      fill: "url(#crosses)",
    });
  return inRows(
    keys.map((key) => ({
      ...key,
      long: key.text.length + (key.parts ? labelLength(key.parts, key.behind) : key.behind.length),
    })),
    left,
    right,
  );
}

/** @param {Selected} layer @param {ReturnType<typeof areaKey>} items @param {number} top */
function drawAreaKey(layer, items, top) {
  layer
    .selectAll("rect")
    .data(items)
    .join("rect")
    .attr("class", ({ name }) => name)
    .attr("fill", ({ fill }) => fill)
    .attr("x", ({ at }) => at)
    .attr("y", ({ row }) => top + KEY_ROW * row - 6)
    .attr("width", 24)
    .attr("height", 13);
  layer
    .selectAll("text")
    .data(items)
    .join("text")
    .attr("class", "label")
    .attr("x", ({ at }) => at + 29)
    .attr("y", ({ row }) => top + KEY_ROW * row + 4)
    .each(function ({ text, parts, behind }) {
      const own = d3.select(this);
      writeLabel(own, parts ?? { symbol: "", tilde: false, below: "", above: "" }, behind);
      own.insert("tspan", ":first-child").text(text);
    });
}

/** The area that holds a place, by its parameters. @param {Panel} panel @param {number} across @param {number} along */
function areaAt(panel, across, along) {
  return panel.areas.find(
    ({ polygon }) => polygon.filter((ring) => d3.polygonContains(ring, [across, along])).length % 2 === 1,
  );
}

/** The rows of a table of areas. @param {Panel} panel */
function areaRows(panel) {
  return panel.areas.map(({ id, says, part, doubt }) => [id, says, `${shown(100 * part, 3)} %`, doubt]);
}
