// Requests to the service, with the bearer token if it needs one, and the stream of events.
let token = sessionStorage.getItem("opir-token") || "";

export async function ask(path, options = {}) {
  for (;;) {
    const headers = { ...(options.headers || {}), ...(token ? { Authorization: `Bearer ${token}` } : {}) };
    const answer = await fetch(path, { ...options, headers });
    if (answer.status !== 401) return answer;
    await tokenEntered();
  }
}

function tokenEntered() {
  const dialog = document.getElementById("ask");
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      token = document.getElementById("token").value.trim();
      sessionStorage.setItem("opir-token", token);
      resolve();
    }, { once: true });
    if (!dialog.open) dialog.showModal();
  });
}

// Calls `on(event, data)` for each server-sent event; reconnects when the stream breaks.
export async function follow(path, on) {
  for (;;) {
    try {
      const answer = await ask(path);
      if (answer.ok) await read(answer.body.getReader(), on);
    } catch { /* reported below, as for a stream that ended */ }
    on("lost", {});
    await new Promise((resolve) => setTimeout(resolve, 2000));
  }
}

async function read(reader, on) {
  const decoder = new TextDecoder();
  let text = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    text += decoder.decode(value, { stream: true });
    const parts = text.split("\n\n");
    text = parts.pop();
    for (const part of parts) {
      const lines = part.split("\n");
      const event = lines.find((line) => line.startsWith("event: ")), data = lines.find((line) => line.startsWith("data: "));
      if (event && data) on(event.slice(7), JSON.parse(data.slice(6)));
    }
  }
}
