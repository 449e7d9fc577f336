// What stands around the pictures: names, choices, keys; and the beginning.

/** Fill a select element. @param {string} id @param {[string, string][]} options */
function fill(id, options) {
  element(id).replaceChildren(...options.map(([value, text]) => new Option(text, value)));
}

/** A box to tick, with what it stands for. @param {string} name @param {string} text @param {string} [look] @param {string} [d] */
function toggle(name, text, look = "", d = "M1,6H25") {
  const label = document.createElement("label"),
    box = document.createElement("input");
  box.type = "checkbox";
  box.dataset.hides = name;
  box.addEventListener("change", () => {
    const hide = new Set(state.hide);
    if (box.checked) hide.delete(name);
    else hide.add(name);
    change({ hide });
  });
  label.append(box);
  if (look) {
    const swatch = d3
      .create("svg")
      .attr("class", "swatch")
      .attr("viewBox", "0 0 26 12")
      .attr("aria-hidden", "true");
    swatch.append("path").attr("class", look).attr("d", d);
    label.append(/** @type {Node} */ (swatch.node()));
  }
  label.append(text);
  return label;
}

/** Everything that can be chosen. */
function drawChoices() {
  element("toggles").replaceChildren(
    toggle("stable", "stable", "branch nowall stable"),
    toggle("unstable", "unstable", "branch nowall unstable"),
    ...page.walls.map((wall, k) => toggle(`wall ${wall}`, `wall ${wall}`, `branch stable ${wallClass(k)}`)),
    toggle("events", "real events"),
    toggle("ghosts", "ghosts"),
    ...(SMALL ? [toggle(SMALL, SMALL, "branch small")] : []),
    toggle("labels", "labels"),
    toggle("runs", "stable runs"),
    ...ways.map((way, k) => toggle(way, k ? `${way}: other ones` : way, "swept nowall", markPath(k, 13, 6))),
  );
  fill(
    "x",
    page.varying.map((name) => [name, withUnit(name)]),
  );
  element("y").append(...Object.entries(COLUMNS_DRAWN).map(([value, text]) => new Option(text, value)));
  fill(
    "member",
    page.members.map((member, place) => [String(place), valuesText(member.fixed)]),
  );
  fill(
    "panel",
    page.panels.map((panel, place) => [String(place), valuesText(panel.fixed) || withUnit(panel.across)]),
  );
  element("member-label").hidden = page.members.length < 2;
  element("scope-label").hidden = page.members.length < 2;
  element("panel-label").hidden = page.panels.length < 2;
  element("views").hidden = page.curves.length === 0;
  element("unphysical-label").hidden = page.branches.length === 0;
}

/** The branches of the member shown, each to be hidden. */
function drawBranchChoice() {
  element("branches").replaceChildren(
    ...page.branches
      .filter((_, place) => page.members[state.member]?.branches.includes(place))
      .map((branch) => toggle(branch.id, `${branch.id} ${branch.notation} (${branch.word.slice(0, 24)})`)),
  );
}

/** Let choices show the state. */
function drawControls() {
  for (const [id, value] of Object.entries({
    x: state.x,
    y: state.y,
    member: String(state.member),
    unphysical: state.unphysical,
    filter: state.filter,
    ghosts: state.ghosts,
    scope: state.scope,
    panel: String(state.panel),
  })) {
    const control = /** @type {HTMLInputElement} */ (element(id));
    if (control.value !== value) control.value = value;
  }
  for (const box of document.querySelectorAll("input[data-hides]")) {
    const own = /** @type {HTMLInputElement} */ (box);
    own.checked = !hidden(own.dataset.hides ?? "");
  }
  for (const tab of document.querySelectorAll("#views button")) {
    const own = tab.getAttribute("data-view") === state.view;
    tab.setAttribute("aria-selected", String(own));
    tab.setAttribute("tabindex", own ? "0" : "-1");
  }
  element("view-diagram").hidden = state.view !== "diagram";
  element("view-plane").hidden = state.view !== "plane";
}

/** What a reader has to know before trusting the picture. */
function drawWarnings() {
  const texts = [
    ...page.shown.remarks,
    ...page.branches.flatMap((branch) => branch.missed.map((text) => `${branch.id}: not located: ${text}`)),
    ...page.curves.flatMap((curve) => curve.missed.map((text) => `curve ${curve.id}: ${text}`)),
  ];
  if (page.unknown) texts.push(`Orbits are not drawn: ${page.unknown}.`);
  element("warnings").hidden = texts.length === 0;
  const lines = texts.map((text) => {
    const line = document.createElement("p");
    line.textContent = text;
    return line;
  });
  const rest = document.createElement("details"),
    head = document.createElement("summary");
  head.textContent = `${lines.length} remarks on what could not be located or shown`;
  rest.append(head, ...lines);
  element("warnings").replaceChildren(...(lines.length > 3 ? [rest] : lines));
}

/** Names and fixed parameters. */
function drawHeading() {
  element("name").textContent = page.name;
  element("fixed").textContent = valuesText(page.fixed);
  element("source").textContent = page.shown.source;
  element("survey").hidden = !page.branches.length;
  element("survey").textContent = `Stable runs: ${page.reading.incomplete}.`;
  element("made").textContent =
    `Made by contimpact ${page.version}. Drawn with D3 (ISC licence). This page loads nothing from anywhere; ` +
    "its address keeps what is looked at.";
}

const REDRAWN = [
  "view",
  "member",
  "x",
  "y",
  "xlim",
  "ylim",
  "hide",
  "unphysical",
  "at",
  "filter",
  "ghosts",
  "scope",
];
const LISTED = ["filter", "ghosts", "sort", "scope", "member", "x"];

observers.push((changed) => {
  const any = (/** @type {string[]} */ names) => names.some((name) => changed.has(name));
  if (any(["member"])) drawBranchChoice();
  drawControls();
  if (state.view === "diagram" && any(REDRAWN)) drawDiagram();
  if (state.view === "plane" && any(["view", "panel", "plane", "member"])) drawPlane();
  if (any(["panel"])) drawPlaneTables();
  if (any(["at", "view", "x"]) && state.view === "diagram") drawOrbit();
  if (any(LISTED)) drawTable();
  if (any(["x"])) drawTransitions();
  if (changed.has("at")) markRow(true);
});

for (const id of ["x", "y", "unphysical"]) {
  element(id).addEventListener("change", (event) =>
    change({
      [id]: /** @type {HTMLSelectElement} */ (event.target).value,
      ylim: null,
      ...(id === "x" ? { xlim: null } : {}),
    }),
  );
}
element("member").addEventListener("change", (event) =>
  openMember(Number(/** @type {HTMLSelectElement} */ (event.target).value)),
);
for (const tab of document.querySelectorAll("#views button")) {
  tab.addEventListener("click", () => change({ view: tab.getAttribute("data-view") ?? "diagram" }));
}
element("views").addEventListener("keydown", (event) => {
  if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
  change({ view: state.view === "diagram" ? "plane" : "diagram" });
  element(`tab-${state.view}`).focus();
});
element("zoom-in").addEventListener("click", () => zoomBy(0.5));
element("zoom-out").addEventListener("click", () => zoomBy(2));
element("zoom-all").addEventListener("click", () => change({ xlim: null, ylim: null }));

/** Go along the branch. @param {number} by */
function step(by) {
  const place = placeOf(state.at) ?? firstPlace();
  if (!place) return;
  const row = Math.max(0, Math.min(place.family.rows - 1, place.row + by));
  choose(atRow(place.family, row));
}

/** The first point in sight. */
function firstPlace() {
  const [family] = shownFamilies("branch");
  return family ? { family, row: 0, entry: null } : null;
}

/** Go to another branch. @param {number} by */
function other(by) {
  const all = shownFamilies("branch"),
    here = placeOf(state.at);
  if (!all.length) return;
  const at = here ? all.indexOf(here.family) + by : 0,
    family = all[(at + all.length) % all.length];
  choose(atRow(family, Math.floor(family.rows / 2)));
}

/** Go to another event, in the order of the table. @param {number} by */
function otherEvent(by) {
  const all = inOrder().filter((entry) => shownEntries().includes(entry)),
    at = all.findIndex((entry) => entry.id === state.at);
  if (all.length)
    choose(all[at < 0 ? (by > 0 ? 0 : all.length - 1) : (at + by + all.length) % all.length].id);
}

/** Zoom about the chosen point, if there is one: of its values, about that nearest to the middle. @param {number} factor */
function zoomBy(factor) {
  const place = placeOf(state.at),
    middle = d3.mean(drawn.limits.y) ?? 0;
  const spots = place && memberOf(place.family) === state.member ? spotsOf(place) : [];
  const finite = spots.filter((spot) => spot.every(Number.isFinite));
  zoomTo(
    scaled(
      drawn.limits,
      factor,
      d3.least(finite, ([, y]) => Math.abs(y - middle)),
    ),
  );
}

/** @type {Record<string, () => void>} */
const KEYS = {
  ArrowRight: () => step(1),
  ArrowLeft: () => step(-1),
  ArrowUp: () => other(-1),
  ArrowDown: () => other(1),
  n: () => otherEvent(1),
  p: () => otherEvent(-1),
  " ": () => moving && play(!playing),
  "+": () => zoomBy(0.5),
  "=": () => zoomBy(0.5),
  "-": () => zoomBy(2),
  0: () => change({ xlim: null, ylim: null }),
  Escape: () => change({ at: "" }),
};
element("diagram").addEventListener("keydown", (event) => {
  const act = event.ctrlKey || event.metaKey || event.altKey ? undefined : KEYS[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});
element("plane").addEventListener("keydown", (event) => {
  const factor = { "+": 0.5, "=": 0.5, "-": 2 }[event.key];
  if (factor) zoomPlane(scaled(planeDrawn.limits, factor));
  else if (event.key === "0") change({ plane: null });
});

/** Everything anew: at first, and where the address or the size has changed. */
function drawAll() {
  change(state);
}

drawHeading();
drawChoices();
drawBranchChoice();
drawWarnings();
Object.assign(state, cited());
drawAll();
drawPlaneTables();
addEventListener("hashchange", () => {
  if (location.hash.slice(1) !== fragment()) change(cited());
});
document.addEventListener("click", (event) => {
  const menu = /** @type {HTMLDetailsElement} */ (element("show"));
  if (menu.open && !menu.contains(/** @type {Node} */ (event.target))) menu.open = false;
});
element("show").addEventListener("keydown", (event) => {
  if (event.key !== "Escape") return;
  /** @type {HTMLDetailsElement} */ (element("show")).open = false;
  /** @type {HTMLElement | null} */ (document.querySelector("#show summary"))?.focus();
});
dark.addEventListener("change", drawAll);
let width = document.body.clientWidth;
addEventListener("resize", () => {
  if (document.body.clientWidth === width) return;
  width = document.body.clientWidth;
  drawAll();
});
document.documentElement.dataset.ready = "true";
