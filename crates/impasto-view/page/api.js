// Requests to the server. What fails is an Error whose message may be shown.

export async function request(method, address, body) {
  const options = { method, headers: {} };
  if (body instanceof Blob) {
    options.body = body;
    options.headers["Content-Type"] = body.type || "application/octet-stream";
  } else if (body !== undefined) {
    options.body = JSON.stringify(body);
    options.headers["Content-Type"] = "application/json";
  }
  let answer;
  try {
    answer = await fetch(address, options);
  } catch {
    throw new Error("The studio does not answer. Is the program still running?");
  }
  const text = await answer.text();
  let content = null;
  try {
    content = text === "" ? null : JSON.parse(text);
  } catch {
    content = null;
  }
  if (!answer.ok) {
    const fault = new Error(content?.error ?? refusal(answer.status));
    fault.status = answer.status;
    throw fault;
  }
  return content;
}

function refusal(status) {
  if (status === 401 || status === 403) {
    return "The studio wants its token: open the address that the program printed.";
  }
  if (status === 413) return "That is larger than the studio takes.";
  return `The studio refused (${status}).`;
}

export const get = (address) => request("GET", address);
export const post = (address, body) => request("POST", address, body);
