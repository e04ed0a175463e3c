// The service's OpenAPI document as a page; every request can be sent from it.
import { ask } from "/page/service.js";

const MOST = 20000;

function make(tag, text, parent, attributes = {}) {
  const element = document.createElement(tag);
  if (text !== null) element.textContent = text;
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  parent.append(element);
  return element;
}

// A schema in short: its type, its limits, or the name of the schema that it refers to.
function short(schema) {
  if (!schema) return "";
  if (schema.$ref) return schema.$ref.split("/").pop();
  if (schema.anyOf) return schema.anyOf.map(short).join(" or ");
  if (schema.enum) return schema.enum.join(" | ");
  if (schema.type === "array") return `list of ${short(schema.items)}`;
  const limits = [["minimum", "≥ "], ["exclusiveMinimum", "> "], ["maximum", "≤ "], ["default", "default "]].filter(([name]) => name in schema).map(([name, word]) => `${word}${schema[name]}`);
  return [schema.type || schema.format || "any", ...limits].join(", ");
}

function showRequest(path, method, request, parent) {
  const section = make("section", null, parent, { "aria-label": `${method.toUpperCase()} ${path}` });
  const title = make("h2", null, section);
  make("code", `${method.toUpperCase()} ${path}`, title);
  make("p", [request.summary, request.description].filter(Boolean).join(". "), section);
  const form = make("form", null, section), inputs = [];
  for (const parameter of request.parameters || []) {
    const label = make("label", `${parameter.name} (${parameter.in}): ${short(parameter.schema)}${parameter.description ? `; ${parameter.description}` : ""}`, form);
    inputs.push([parameter, make("input", null, label, { autocomplete: "off" })]);
  }
  let body = null;
  if (request.requestBody) {
    const media = Object.values(request.requestBody.content)[0], label = make("label", `Body: ${short(media.schema)}`, form, { class: "wide" });
    body = make("textarea", null, label, { rows: 6, spellcheck: "false" });
    const example = media.examples && Object.values(media.examples)[0];
    if (example) body.value = JSON.stringify(example.value, null, 2);
  }
  const answers = Object.entries(request.responses).map(([status, answer]) => `${status} ${answer.description}`);
  make("p", `Answers: ${answers.join("; ")}`, section, { class: "soft" });
  if (path === "/stream") return;
  make("button", "Send", form, { type: "submit", "aria-label": `Send ${method.toUpperCase()} ${path}` });
  const output = make("pre", "", section, { tabindex: "0", "aria-label": `Answer of ${path}`, hidden: "" });
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    output.hidden = false; output.textContent = "…";
    try { output.textContent = await sent(path, method, inputs, body); } catch { output.textContent = "The service cannot be reached"; }
  });
}

async function sent(path, method, inputs, body) {
  const given = inputs.filter(([, input]) => input.value !== ""), headers = body ? { "Content-Type": "application/json" } : {};
  const query = new URLSearchParams(given.filter(([parameter]) => parameter.in === "query").map(([parameter, input]) => [parameter.name, input.value]));
  for (const [parameter, input] of given) if (parameter.in === "header") headers[parameter.name] = input.value;
  const answer = await ask(`${path}${query.size ? `?${query}` : ""}`, { method: method.toUpperCase(), headers, ...(body ? { body: body.value } : {}) });
  const text = await answer.text(), tag = answer.headers.get("etag");
  let shown = text;
  try { shown = JSON.stringify(JSON.parse(text), null, 2); } catch { /* not JSON: as it is */ }
  const rest = shown.length > MOST ? `\n… ${shown.length - MOST} more characters` : "";
  return `${answer.status} ${answer.statusText}${tag ? `\nETag: ${tag}` : ""}\n\n${shown.slice(0, MOST)}${rest}`;
}

function showSchemas(schemas, parent) {
  const section = make("section", null, parent, { "aria-label": "Schemas" });
  make("h2", "Schemas", section);
  for (const [name, schema] of Object.entries(schemas)) {
    const part = make("details", null, section, { id: `schema-${name}` });
    make("summary", name, part);
    const list = make("dl", null, part);
    for (const [key, value] of Object.entries(schema.properties || {})) { make("dt", key, list); make("dd", [short(value), value.description].filter(Boolean).join("; "), list); }
    make("pre", JSON.stringify(schema, null, 2), part, { tabindex: "0", "aria-label": `Schema ${name}` });
  }
}

async function start() {
  const answer = await ask("/openapi.json"), found = await answer.json(), parent = document.getElementById("requests");
  document.getElementById("about").textContent = `${found.info.summary} ${found.info.description}`;
  for (const [path, methods] of Object.entries(found.paths)) for (const [method, request] of Object.entries(methods)) showRequest(path, method, request, parent);
  showSchemas(found.components.schemas, parent);
}

start().catch(() => { document.getElementById("about").textContent = "The description cannot be read: the service cannot be reached."; });
