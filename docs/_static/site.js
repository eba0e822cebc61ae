/* What the theme leaves without a name, or out of reach of the keyboard. */
document.addEventListener("DOMContentLoaded", async () => {
  for (const toggle of document.querySelectorAll("nav.bd-links summary")) {
    const page = toggle.closest("li").querySelector("a").textContent.trim();
    toggle.setAttribute("aria-label", `Pages below ${page}`);
  }
  await window.MathJax?.startup.promise;
  for (const equation of document.querySelectorAll("mjx-container")) {
    if (equation.scrollWidth > equation.clientWidth) equation.tabIndex = 0;
  }
});
