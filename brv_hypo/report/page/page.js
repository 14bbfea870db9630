// Opens what is linked to. Draws the page's charts with its own colours, those of a folded section when it is opened, and
// keeps charts over time at one zoom and one cursor.
(async () => {
  const root = document.documentElement;
  const folds = [...document.querySelectorAll("details")];
  const reveal = () => {
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    for (let node = target; node; node = node.parentElement) if (node.tagName === "DETAILS") node.open = true;
    if (target) target.scrollIntoView();
  };
  const unfold = document.getElementById("unfold");
  if (unfold) unfold.addEventListener("click", () => {
    const open = unfold.getAttribute("aria-pressed") !== "true";
    for (const fold of folds) fold.open = open;
    unfold.setAttribute("aria-pressed", open);
    unfold.textContent = open ? "Fold all" : "Open all";
  });
  addEventListener("hashchange", reveal);
  reveal();
  let before = [];  // what was folded before printing
  addEventListener("beforeprint", () => {
    before = folds.filter((fold) => !fold.open);
    for (const fold of before) fold.open = true;
  });
  addEventListener("afterprint", () => { for (const fold of before) fold.open = false; });

  const unpacked = async (id) => {
    const packed = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
    return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  };
  const nodes = [...document.querySelectorAll(".chart")];
  if (nodes.length && typeof DecompressionStream === "undefined") {
    for (const node of nodes) node.textContent = "The charts need a browser of 2023 or later.";
    return;
  }
  if (!nodes.length) return;
  const script = document.createElement("script");
  script.textContent = await unpacked("library");
  document.head.append(script);
  const charts = JSON.parse(await unpacked("charts"));

  const painted = (value, style) => {
    if (typeof value === "string") return value.startsWith("--") ? style.getPropertyValue(value).trim() : value;
    if (ArrayBuffer.isView(value)) return value;
    if (Array.isArray(value)) return value.map((each) => painted(each, style));
    if (value && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, painted(each, style)]));
    }
    return value;
  };
  const common = {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "x unified", hoversubplots: "axis",
    font: { family: "system-ui, -apple-system, 'Segoe UI', Helvetica, Arial, sans-serif", size: 13, color: "--ink" },
    margin: { l: 60, r: 20, t: 84, b: 46 }, hoverlabel: { bgcolor: "--paper", bordercolor: "--rule" },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: "--quiet", activecolor: "--accent" },
    legend: { orientation: "h", yref: "container", yanchor: "top", y: 1, x: 0, itemsizing: "constant" },
  };
  const UNNAMED = 34;  // px: the margin above a frame without names of marks, where the legend stands
  const PAPER = 660;  // px: the width of a sheet between its margins
  const SHEET = 880;  // px: the height that a chart may have on it, with heading and caption
  const CLOSER = 0.8;  // of its height on a screen, so that two charts of two panels stand on a sheet
  const LEAST = 300;  // px: charts of no more keep their height
  const SMALLER = 11;  // px: the letters of closer panels
  const config = { responsive: true, displaylogo: false, modeBarButtons: [["toImage", "resetScale2d"]] };
  const linked = nodes.filter((node, index) => charts[index].time);
  const paths = nodes.filter((node, index) => charts[index].path);
  const drawn = new Set();
  const visible = (node) => node.checkVisibility ? node.checkVisibility() : node.offsetParent !== null;
  let leading = null;
  const others = (node, act) => {
    if (leading) return;
    leading = node;
    Promise.all(linked.filter((other) => other !== node && drawn.has(other)).map(act))
      .finally(() => { leading = null; });
  };
  const listenToPath = (node) => {
    node.on("plotly_hover", (event) => {
      others(node, (other) => Plotly.Fx.hover(other, { xval: event.points[0].customdata }, "xy"));
    });
    node.on("plotly_unhover", () => others(node, (other) => Plotly.Fx.unhover(other)));
  };
  let shown = null;  // the times that charts over time are zoomed to
  const showOnPaths = (range) => {
    if (String(range) === String(shown)) return;
    shown = range;
    for (const node of paths) if (drawn.has(node)) drawOne(node, getComputedStyle(root));
  };
  const listen = (node) => {
    node.on("plotly_relayout", (change) => {
      const range = change["xaxis.range"] ||
        ("xaxis.range[0]" in change ? [change["xaxis.range[0]"], change["xaxis.range[1]"]] : null);
      if (range) others(node, (other) => Plotly.relayout(other, { "xaxis.range": range }));
      else if (change["xaxis.autorange"]) others(node, (other) => Plotly.relayout(other, { "xaxis.autorange": true }));
      if (range || change["xaxis.autorange"]) showOnPaths(range);
    });
    node.on("plotly_hover", (event) => {
      others(node, (other) => Plotly.Fx.hover(other, { xval: event.xvals[0] }, "xy"));
    });
    node.on("plotly_unhover", () => others(node, (other) => Plotly.Fx.unhover(other)));
  };
  const drawOne = async (node, style) => {
    let chart = charts[nodes.indexOf(node)];
    const height = "printing" in root.dataset
      ? Math.min(Math.max(CLOSER * chart.height, Math.min(chart.height, LEAST)), SHEET) : chart.height;
    if (chart.path) {
      const { l, r, t, b } = common.margin, width = "printing" in root.dataset ? PAPER : node.clientWidth;
      chart = { ...chart, ...stretchesOf(chart.path, [width - l - r, height - t - b], shown) };
    }
    const margin = { ...common.margin, t: chart.named ? common.margin.t : UNNAMED };
    const layout = painted({ ...common, margin, ...chart.layout, height }, style);
    if ("printing" in root.dataset) {
      layout.width = PAPER;
      layout.font.size = SMALLER;
    }
    if (node.layout && node.layout.xaxis && chart.time) layout.xaxis.range = node.layout.xaxis.range;
    else if (chart.time && shown) layout.xaxis.range = shown;
    // Axes that are tied to each other keep old ranges when they are drawn over.
    await Plotly[chart.path ? "newPlot" : "react"](node, painted(chart.traces, style), layout, config);
    if (chart.path) listenToPath(node);
    else if (chart.time && !drawn.has(node)) listen(node);
    drawn.add(node);
  };
  const draw = async (some = nodes) => {
    for (const node of some) {
      if (visible(node)) await drawOne(node, getComputedStyle(root));
      else if (drawn.delete(node)) Plotly.purge(node);  // drawn anew when it is opened, at the size and in the colours of then
    }
    root.dataset.drawn = drawn.size;
  };
  await draw();
  document.addEventListener("toggle", (event) => draw(nodes.filter((node) => event.target.contains(node))), true);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => draw());
  addEventListener("beforeprint", () => { root.dataset.printing = ""; draw(); });
  addEventListener("afterprint", () => { delete root.dataset.printing; draw(); });
})();
