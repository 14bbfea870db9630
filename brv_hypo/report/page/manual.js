// Shows the sections of the manual that hold every word of the search.
const field = document.getElementById("search");
const said = document.getElementById("found");
const sections = [];
for (const article of document.querySelectorAll("article")) {
  let section = null;
  for (const part of [...article.children]) {
    if (/^H[12]$/.test(part.tagName) || section === null) {
      section = document.createElement("section");
      article.append(section);
      sections.push(section);
    }
    section.append(part);
  }
}
const search = () => {
  const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
  let count = 0;
  for (const section of sections) {
    const text = section.textContent.toLowerCase();
    section.hidden = !words.every((word) => text.includes(word));
    count += section.hidden ? 0 : 1;
  }
  for (const article of document.querySelectorAll("article")) {
    article.hidden = [...article.children].every((section) => section.hidden);
  }
  said.textContent = words.length ? `${count} of ${sections.length} sections` : "";
};
field.addEventListener("input", search);
document.documentElement.dataset.sections = sections.length;
