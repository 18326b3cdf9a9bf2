// Requests to the program that serves this page; a refusal becomes a Refused with the parts of its message.

export class Refused extends Error {
  constructor(parts) { super(parts.what); this.parts = parts; }
}

async function read(answer) {
  const content = await answer.json().catch(() => ({ what: "the program does not answer; is idic draw still running?" }));
  if (!answer.ok) throw new Refused(content);
  return content;
}

const lost = () => { throw new Refused({ what: "idic draw does not answer. A started run continues; start idic draw again to watch it." }); };
export const get = (name, query = {}) => fetch(`api/${name}?${new URLSearchParams(query)}`).catch(lost).then(read);
export const post = (name, content) => fetch(`api/${name}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content) }).catch(lost).then(read);
