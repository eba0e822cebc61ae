// A filter of the tables of the API: rows whose name or words have all that is typed.
document.addEventListener("DOMContentLoaded", () => {
  const place = document.getElementById("api-filter");
  if (!place) return;
  place.innerHTML = '<label>Filter <input type="search" autocomplete="off"></label> <output></output>';
  const [input, said] = [place.querySelector("input"), place.querySelector("output")];
  const rows = [...document.querySelectorAll("article table.autosummary tr")];
  const others = document.querySelectorAll("article table:not(.autosummary), article p");
  input.addEventListener("input", () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = rows.filter((row) => {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
      return !row.hidden;
    });
    for (const part of document.querySelectorAll("article section section")) {
      const own = [...part.querySelectorAll("table.autosummary tr")];
      part.hidden = words.length > 0 && own.every((row) => row.hidden);
    }
    for (const other of others) other.hidden = words.length > 0 && !other.closest("table.autosummary");
    said.textContent = words.length ? `${found.length} of ${rows.length} names` : "";
  });
});
