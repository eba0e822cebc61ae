"use strict";
// The error staircase: a tab for each step. Without this script all steps stand one below the other.
(() => {
  const list = document.querySelector("#steps .stairs");
  if (list) {
    const tabs = [...list.querySelectorAll("a")];
    const panels = tabs.map((tab) => document.getElementById(tab.hash.slice(1)));
    const select = (n, focus) => {
      tabs.forEach((tab, i) => {
        tab.setAttribute("aria-selected", String(i === n));
        tab.tabIndex = i === n ? 0 : -1;
        panels[i].hidden = i !== n;
      });
      if (focus) tabs[n].focus({ preventScroll: true });
    };
    const current = () => tabs.findIndex((tab) => tab.getAttribute("aria-selected") === "true");
    list.setAttribute("role", "tablist");
    list.setAttribute("aria-label", "Steps");
    tabs.forEach((tab, i) => {
      tab.setAttribute("role", "tab");
      tab.id = `tab-${i}`;
      tab.setAttribute("aria-controls", panels[i].id);
      panels[i].setAttribute("role", "tabpanel");
      panels[i].setAttribute("aria-labelledby", tab.id);
      panels[i].tabIndex = 0;
      tab.addEventListener("click", (event) => {
        event.preventDefault();
        select(i, true);
      });
    });
    document.addEventListener("keydown", (event) => {
      if (event.altKey || event.ctrlKey || event.metaKey || event.shiftKey) return;
      const at = document.activeElement;
      // Elsewhere arrows keep what they do: a wide table scrolls.
      if (at !== document.body && !list.contains(at) && !panels.includes(at)) return;
      const n = current();
      const to = { ArrowRight: n + 1, ArrowLeft: n - 1 };
      if (list.contains(at)) Object.assign(to, { Home: 0, End: tabs.length - 1 });
      if (!(event.key in to)) return;
      event.preventDefault();
      select(Math.min(Math.max(to[event.key], 0), tabs.length - 1), list.contains(at));
    });
    const asked = () => panels.findIndex((panel) => `#${panel.id}` === location.hash);
    // The result first; the way to it is a click away.
    select(asked() < 0 ? tabs.length - 1 : asked(), false);
    window.addEventListener("hashchange", () => {
      if (asked() >= 0) select(asked(), false);
      if (asked() >= 0) panels[asked()].scrollIntoView();
    });
  }
  const payload = document.querySelector(".sk-payload");
  if (payload) {
    const host = document.querySelector(".sk-host");
    skhoidBench.wire
      .unpackText(payload.textContent)
      .then((found) => skhoidBench.mount(host, found.view, skhoidBench.staticBackend(found)))
      .catch(() => {
        host.textContent = "This browser cannot show this part. The pictures below show the same.";
      });
  }
})();
