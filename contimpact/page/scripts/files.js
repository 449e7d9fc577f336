// Downloads: pictures as they are shown, and what is in sight as tables.

/** Hand a file to the reader. @param {string} name @param {Blob} content */
function download(name, content) {
  const link = document.createElement("a"),
    address = URL.createObjectURL(content);
  link.href = address;
  link.download = `${page.name.replace(/[^\w.-]+/g, "_").slice(0, 60) || "diagram"}-${name}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}

/** @param {string} id */
function saveSvg(id) {
  download(`${id}.svg`, new Blob([svgText(id)], { type: "image/svg+xml" }));
}

/** The picture in three pixels for one. @param {string} id */
function savePng(id) {
  const picture = new Image(),
    address = URL.createObjectURL(new Blob([svgText(id)], { type: "image/svg+xml" }));
  picture.onload = () => {
    const canvas = document.createElement("canvas");
    canvas.width = 3 * picture.width;
    canvas.height = 3 * picture.height;
    canvas.getContext("2d")?.drawImage(picture, 0, 0, canvas.width, canvas.height);
    URL.revokeObjectURL(address);
    canvas.toBlob((content) => content && download(`${id}.png`, content), "image/png");
  };
  picture.src = address;
}

/** A cell of a table; a text that would be a formula in a spreadsheet has ' before it. @param {string | number | boolean | null | undefined} value */
function csvCell(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "";
  if (typeof value === "boolean") return value ? "1" : "0";
  if (typeof value === "number") return String(value);
  const text = /^[=+\-@\t\r']/.test(value) ? `'${value}` : value;
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** @param {string} name @param {(string | number | boolean | null | undefined)[][]} rows */
function saveCsv(name, rows) {
  download(
    name,
    new Blob([rows.map((cells) => `${cells.map(csvCell).join(",")}\n`).join("")], { type: "text/csv" }),
  );
}

/** The points of the diagram in sight: a row for each. */
function pointsInSight() {
  const { limits } = drawn,
    names = [...new Set([...page.varying, ...apart])];
  const head = ["branch", "orbit", "word", "row", ...names, "line", "wall", "value", "status", "reason"];
  if (page.quantities.includes("margin")) head.push("margin", "margin_event");
  /** @type {(string | number | null | undefined)[][]} */
  const rows = [head];
  visitPoints((family, row, k, x, y, wall) => {
    if (!(x >= limits.x[0] && x <= limits.x[1] && y >= limits.y[0] && y <= limits.y[1])) return;
    const line = state.y === "velocity" ? `v${k + 1}` : linesOf(family, state.y)[k].name;
    const status = family.swept ? family.swept.kind : STATUS[ownStatus(family, row)];
    rows.push([
      family.swept ? wayOf(family.swept) : family.id,
      family.notation,
      family.word,
      row,
      ...names.map((name) => family.columns[name]?.[row] ?? null),
      line,
      page.walls[wall] ?? "",
      y,
      status,
      family.reason(row),
      ...(page.quantities.includes("margin") ? [family.columns.margin?.[row], family.nearest(row)] : []),
    ]);
  });
  return rows;
}

/** The events of the table. */
function eventsInSight() {
  const head = [...COLUMNS.map(({ name }) => name), "impacts", "multipliers"];
  return [
    head,
    ...inOrder().map((entry) => [
      ...COLUMNS.map((column) => column.of(entry)),
      entry.impacts.map(({ wall, time, velocity }) => `${wall} ${time} ${velocity}`).join("; "),
      entry.multipliers.map((mu) => (mu ? mu.join(" ") : "infinite")).join("; "),
    ]),
  ];
}

/** The motion that is drawn: times in forcing periods, positions, velocities. */
function motionPoints() {
  const rows = moving?.motion.flights.flatMap(({ t, x, v }, k) =>
    t.map((time, i) => [k + 1, time, ...x.flatMap((each, j) => [each[i], v[j][i]])]),
  );
  const several = moving?.motion.coordinates.length !== 1;
  const names = moving?.motion.coordinates.flatMap((name) => [
    `displacement${several ? ` ${name}` : ""}`,
    `velocity${several ? ` ${name}` : ""}`,
  ]);
  return [["flight", "time", ...(names ?? [])], ...(rows ?? [])];
}

/** The curves of the panel, a row for each point. */
function curvePoints() {
  const panel = page.panels[state.panel],
    names = [...new Set([...page.curves[panel.curves[0]].parameters, panel.along])];
  const rows = panel.curves.flatMap((place) =>
    Array.from({ length: page.curves[place].rows }, (_, row) => {
      const { curve, columns, ghost } = curves[place];
      return [
        curve.id,
        curve.label,
        curve.notation,
        ...names.map((name) => columns[name]?.[row] ?? null),
        Boolean(ghost[row]),
      ];
    }),
  );
  return [["curve", "label", "orbit", ...names, "ghost"], ...rows];
}

element("save-svg").addEventListener("click", () => saveSvg("diagram"));
element("save-png").addEventListener("click", () => savePng("diagram"));
element("save-csv").addEventListener("click", () => saveCsv("points.csv", pointsInSight()));
element("save-events").addEventListener("click", () => saveCsv("events.csv", eventsInSight()));
element("plane-svg").addEventListener("click", () => saveSvg("plane"));
element("plane-png").addEventListener("click", () => savePng("plane"));
element("plane-csv").addEventListener("click", () => saveCsv("curves.csv", curvePoints()));
for (const button of document.querySelectorAll("[data-saves]")) {
  const id = button.getAttribute("data-saves") ?? "";
  button.setAttribute("aria-label", `Download as SVG: ${id}`);
  button.addEventListener("click", () => saveSvg(id));
}
element("save-motion").addEventListener("click", () => saveCsv("motion.csv", motionPoints()));
