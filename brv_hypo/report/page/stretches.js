// A path, stretch by stretch, as traces and layout: of the whole, or of the times [from, to] that other charts show.
const stretchesOf = (() => {
  const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const GAP = { x: 0.03, y: 34 };  // share of the width; px, which hold a title and the tick labels
  const OUTSIDE = { xref: "paper", yref: "paper", showarrow: false };
  const counted = (path, length) => {
    const count = Math.min(Math.max(Math.round(length / (path.cycle * path.cycles)), 1), path.most);
    return count < path.columns ? count : Math.ceil(count / path.columns) * path.columns;
  };
  const lines = (path, k, inside) => {
    const place = { type: "scatter", xaxis: `x${k || ""}`, yaxis: `y${k || ""}`, showlegend: !k };
    const part = (name) => path[name].subarray(...inside);
    const template = "%{customdata:.2f} s<br>%{x:.2f}, %{y:.2f}<extra></extra>";
    const line = { mode: "lines", name: "path", line: { color: "--measured", width: 1.2 } };
    const start = { mode: "markers", name: "start", hoverinfo: "skip", marker: { color: "--second", size: 7 } };
    return [
      { ...place, ...line, x: part("x"), y: part("y"), customdata: part("t"), hovertemplate: template },
      { ...place, ...start, x: part("x").slice(0, 1), y: part("y").slice(0, 1) },
    ];
  };
  const placed = (path, count, [width, height]) => {
    const columns = Math.min(count, path.columns), rows = Math.ceil(count / columns), gap = GAP.y / height;
    const wide = (1 - GAP.x * (columns - 1)) / columns;
    const high = Math.min((1 - gap * (rows - 1)) / rows, (wide * width) / height);
    const bottom = 1 - rows * high - (rows - 1) * gap;
    const edge = (wide - (high * height) / width) / 2;  // of the first square, where it is narrower than its place
    return { columns, rows, wide, high, left: wide + GAP.x, down: high + gap, bottom, edge };
  };
  const axes = (path, k, { columns, rows, wide, high, left, down }, limit) => {
    const column = k % columns, row = Math.floor(k / columns), name = k ? k + 1 : "";
    const scale = { range: [-limit, limit], fixedrange: true, constrain: "domain", nticks: 5 };
    const axis = { ...path.axis, ...scale, showgrid: false };
    const x = [column * left, column * left + wide], top = 1 - row * down;
    const y = { domain: [Math.max(top - high, 0), top], constraintoward: "top", scaleanchor: `x${name}` };
    return {
      [`xaxis${name}`]: { ...axis, anchor: `y${name}`, domain: x, showticklabels: row === rows - 1 },
      [`yaxis${name}`]: { ...axis, anchor: `x${name}`, ...y, showticklabels: column === 0 },
      title: { ...OUTSIDE, x: (x[0] + x[1]) / 2, y: top, xanchor: "center", yanchor: "bottom" },
    };
  };
  return (path, size, range) => {
    if (typeof path.t === "string") for (const name of ["t", "x", "y"]) path[name] = floats(path[name]);
    const [from, to] = range || [path.t[0], path.t[path.t.length - 1]];
    const index = (time) => {
      const found = path.t.findIndex((t) => t >= time);
      return found < 0 ? path.t.length : found;
    };
    const count = counted(path, to - from), step = (to - from) / count;
    const digits = Math.max(0, 1 - Math.floor(Math.log10(step)));
    let limit = 0;
    for (let i = index(from); i < index(to); i++) limit = Math.max(limit, Math.abs(path.x[i]), Math.abs(path.y[i]));
    const traces = [], layout = { annotations: [], hovermode: "closest" };
    const places = placed(path, count, size), middle = (1 + places.bottom) / 2;
    for (let k = 0; k < count; k++) {
      const edges = [from + k * step, from + (k + 1) * step];
      traces.push(...lines(path, k ? k + 1 : 0, [index(edges[0]), index(edges[1]) + 1]));
      const { title, ...both } = axes(path, k, places, 1.05 * limit || 1);
      title.text = edges.map((edge) => edge.toFixed(digits)).join("–") + " s";
      layout.annotations.push(title);
      Object.assign(layout, both);
    }
    const below = { x: 0.5, y: places.bottom, xanchor: "center", yanchor: "top", yshift: -26 };
    const beside = { x: places.edge, y: middle, xanchor: "right", xshift: -34, textangle: -90 };
    layout.annotations.push({ ...OUTSIDE, text: path.xTitle, ...below });
    layout.annotations.push({ ...OUTSIDE, text: path.yTitle, ...beside });
    return { traces, layout };
  };
})();
