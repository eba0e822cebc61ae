// A notebook: the kernel computes, through the model of an anywidget.

function widgetBackend(model) {
  const listeners = [];
  const waiting = new Map();
  let last = 0;
  const heard = (content, buffers) => {
    const value = unpack(bufferOf(buffers[0]));
    if (content.id === null) {
      for (const listener of listeners) listener(value.state);
      return;
    }
    const { resolve, reject } = waiting.get(content.id) ?? {};
    waiting.delete(content.id);
    if (!resolve) return;
    if (value.error) reject(new Error(value.error));
    else resolve(value.reply);
  };
  model.on("msg:custom", heard);
  return {
    onState: (listener) => listeners.push(listener),
    close: () => model.off("msg:custom", heard),
    call: (name, args) =>
      new Promise((resolve, reject) => {
        last += 1;
        waiting.set(last, { resolve, reject });
        model.send({ id: last, name, args });
      }),
  };
}

// A copy from its start: a view into a longer message may begin anywhere.
function bufferOf(view) {
  if (view instanceof ArrayBuffer) return view;
  return view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength);
}
