// Requests to the server.

/** An error response of the server. */
export class ApiError extends Error {
  /** @param {number} status @param {{message?: string, help?: string|null, line?: number|null, column?: number|null, value?: string|null}} error */
  constructor(status, error) {
    super(error.message ?? `the server responded with status ${status}`);
    this.status = status;
    this.help = error.help ?? "";
    this.line = error.line ?? null;
    this.column = error.column ?? null;
    /** The path of the refused value. */
    this.value = error.value ?? null;
  }
}

/**
 * @param {string} path below /api/
 * @param {{method?: string, body?: unknown, bytes?: BodyInit, signal?: AbortSignal}} [options]
 * @returns {Promise<Response>}
 */
export async function ask(path, options = {}) {
  const body = options.bytes ?? (options.body === undefined ? undefined : JSON.stringify(options.body));
  const method = options.method ?? (body === undefined ? "GET" : "POST");
  const response = await fetchOrExplain(`/api/${path}`, { method, body, signal: options.signal, credentials: "same-origin" });
  if (response.ok) return response;
  let error = {};
  try {
    error = (await response.json()).error ?? {};
  } catch {
    // The response is not JSON.
  }
  throw new ApiError(response.status, error);
}

/** Help if the server does not respond. */
export const ENDED = `it has probably been stopped: start it again with --port ${location.port}, which keeps the drawings, and open the new URL that it prints`;

/** @param {string} path @param {RequestInit} options */
async function fetchOrExplain(path, options) {
  try {
    return await fetch(path, options);
  } catch (error) {
    if (/** @type {any} */ (error).name === "AbortError") throw error;
    throw Object.assign(new Error(`the server does not respond (${/** @type {any} */ (error).message})`), { help: ENDED });
  }
}

/** @param {string} path @param {Parameters<typeof ask>[1]} [options] @returns {Promise<any>} */
export async function json(path, options) {
  return (await ask(path, options)).json();
}

/**
 * Unpacks a document with arrays: its length as 32 bits, the document, the numbers.
 * @param {ArrayBuffer} buffer
 * @returns {{document: any, arrays: Record<string, {shape: number[], data: Float32Array|Uint8Array}>}}
 */
export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  /** @type {Record<string, {shape: number[], data: Float32Array|Uint8Array}>} */
  const arrays = {};
  for (const { name, type, shape, start } of document.arrays) {
    const count = shape.reduce((/** @type {number} */ a, /** @type {number} */ b) => a * b, 1);
    const at = 4 + length + start;
    arrays[name] = { shape, data: type === "f32" ? new Float32Array(buffer, at, count) : new Uint8Array(buffer, at, count) };
  }
  return { document, arrays };
}

/** @param {string} path @param {Parameters<typeof ask>[1]} [options] */
export async function frame(path, options) {
  return unpack(await (await ask(path, options)).arrayBuffer());
}

/**
 * Reads documents, one a line, as they arrive.
 * @param {string} path @param {Parameters<typeof ask>[1]} options @param {(document: any) => void} each
 */
export async function lines(path, options, each) {
  const response = await ask(path, options);
  if (!response.body) return;
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const parts = (rest + value).split("\n");
    rest = parts.pop() ?? "";
    for (const part of parts) if (part) each(JSON.parse(part));
  }
}

/** Reads the columns of all rows along an axis, by name. @param {string} digest @param {string} axis @param {string} [more] @returns {Promise<Record<string, any[]>>} */
export async function columnsOf(digest, axis, more = "") {
  const answer = await json(`artifacts/${digest}/rows?along=${axis}&limit=1000${more}`);
  return Object.fromEntries(answer.columns.map((/** @type {any} */ column, /** @type {number} */ at) => [column.name, answer.rows.map((/** @type {any[]} */ row) => row[at])]));
}
