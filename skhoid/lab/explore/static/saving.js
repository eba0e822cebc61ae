// What is taken away: the script that gives these numbers, and the report.

// Its buttons, and what they lead to.
function savingParts(bench) {
  const { can } = bench.view;
  const code = el("pre", { tabindex: "0", role: "region", "aria-label": "The script in Python" });
  const shown = el("details", { class: "sk-script" }, el("summary", {}, "The script"), code);
  shown.hidden = true;
  const result = el("p", { class: "sk-saved" });
  const copy = button("Copy as Python", () => copyScript(bench, code, shown), {
    "data-sk-key": "script",
  });
  const save = button("Save report", () => saveReport(bench, result), { "data-sk-key": "report" });
  const buttons = el(
    "div",
    { class: "sk-row" },
    can.script ? copy : null,
    can.report ? save : null,
  );
  return { buttons, results: [result, shown] };
}

async function copyScript(bench, code, shown) {
  const reply = await bench.ask("script", {}, "The script is being written …");
  if (!reply) return;
  setText(code, reply.text);
  shown.hidden = false;
  try {
    await navigator.clipboard.writeText(reply.text);
    bench.say("The script is on the clipboard, and below.");
  } catch {
    shown.open = true;
    bench.say("The clipboard cannot be used from here: copy the script below.");
  }
}

async function saveReport(bench, result) {
  const reply = await bench.ask("report", {}, "The report is being written …");
  if (!reply) return;
  if (!reply.href) {
    setText(result, reply.text);
  } else {
    const link = el("a", { href: reply.href, download: reply.name }, named(reply.name));
    result.replaceChildren("Saved: ", link);
    link.click();
  }
  bench.say(reply.text || `The report is saved as ${isolated(reply.name)}.`);
}
