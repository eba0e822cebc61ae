// Names for what the theme and the gallery leave without one, for those who hear the page.
document.addEventListener("DOMContentLoaded", () => {
  for (const toggle of document.querySelectorAll("summary:has(> .toctree-toggle)")) {
    const page = toggle.closest("li")?.querySelector("a")?.textContent.trim();
    toggle.setAttribute("aria-label", page ? `Pages below ${page}` : "Pages below");
  }
  for (const link of document.querySelectorAll(".sphx-glr-thumbcontainer a.internal")) {
    link.setAttribute("aria-label", link.textContent.trim());
  }
});
// Equations wider than a telephone scroll: by the keyboard too.
window.addEventListener("load", async () => {
  await window.MathJax?.startup?.promise;
  for (const equation of document.querySelectorAll("mjx-container[display], div.math")) {
    if (equation.scrollWidth > equation.clientWidth) equation.tabIndex = 0;
  }
});
