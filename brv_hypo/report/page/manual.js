// Lists the sections of all pages that hold every word of the search, those with it in their titles first.
const field = document.getElementById("search");
const found = document.getElementById("found");
const results = document.getElementById("results");
const search = () => {
  const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
  const holds = (text) => words.every((word) => text.toLowerCase().includes(word));
  const hits = words.length ? sections.filter(([, , title, text]) => holds(`${title} ${text}`)) : [];
  hits.sort((one, other) => holds(other[2]) - holds(one[2]));
  results.replaceChildren(...hits.map(([page, anchor, title]) => {
    const link = document.createElement("a");
    link.href = `${page}.html${anchor && "#"}${anchor}`;
    link.innerHTML = anchor ? `${titles[page]}: ${title}` : title;
    const item = document.createElement("li");
    item.append(link);
    return item;
  }));
  found.textContent = words.length ? `${hits.length} of ${sections.length} sections` : "";
  document.getElementById("pages").hidden = words.length > 0;
};
field.addEventListener("input", search);
