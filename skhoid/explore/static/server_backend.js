// The workbench's own server, at addresses relative to the page.

const SILENT =
  "The workbench does not answer: it may have been closed. Start it again with " +
  '"skhoid workbench"; what you did is kept in its session.';

function serverBackend({ base = document.baseURI, headers = {} } = {}) {
  const listeners = [];
  const events = new EventSource(new URL("api/events", base));
  events.addEventListener("message", (event) => {
    const state = JSON.parse(event.data);
    for (const listener of listeners) listener(state, { partial: true });
  });
  return {
    onState: (listener) => listeners.push(listener),
    close: () => events.close(),
    call: (name, args) => asked(new URL(`api/${name}`, base), headers, args),
  };
}

async function asked(url, headers, args) {
  let response;
  try {
    response = await fetch(url, {
      method: "POST",
      headers: { "content-type": "application/json", ...headers },
      body: JSON.stringify(args),
    });
  } catch {
    throw new Error(SILENT);
  }
  if (response.ok) return unpack(await response.arrayBuffer());
  throw new Error(await messageOf(response));
}

async function messageOf(response) {
  try {
    return (await response.json()).message;
  } catch {
    return `The workbench answered with an error (${response.status}) and did not say why.`;
  }
}
