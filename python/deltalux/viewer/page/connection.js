// The socket: hello, what is sent, and coming back after a loss.

const TOKEN = "deltalux-token";
const REFUSED = 4401;
const LONGEST_WAIT = 4000;
const WHY = {
  1001: "The server has ended",
  1008: "The server refused so many messages",
  1009: "The server refused so long a message",
};

/** The key of this run: out of the address bar, where it could be seen or copied, into this tab's own storage. */
function token() {
  const given = location.hash.slice(1);
  if (given) {
    sessionStorage.setItem(TOKEN, given);
    history.replaceState(null, "", location.pathname + location.search);
  }
  return sessionStorage.getItem(TOKEN) ?? "";
}

export class Connection {
  /** `on` has text(message), binary(header, buffer, start), lost(sentence), refused(). */
  constructor(on) {
    this.on = on;
    this.queue = [];
    this.wait = 250;
    this.order = Promise.resolve();
    this.open();
  }

  open() {
    const key = token();
    if (!key) return this.on.refused();
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => socket.send(JSON.stringify({ hello: key, width: innerWidth, height: innerHeight }));
    // One after the other, though a JPEG takes its time.
    socket.onmessage = ({ data }) => {
      this.order = this.order.then(() => socket === this.socket && this.take(data)).catch(reportError);
    };
    socket.onclose = ({ code }) => this.closed(code);
    this.socket = socket;
  }

  take(data) {
    if (typeof data !== "string") return this.binary(data);
    const message = JSON.parse(data);
    if (message.welcome) this.wait = 250;
    return this.on.text(message);
  }

  binary(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    return this.on.binary(header, buffer, Math.ceil((4 + length) / 8) * 8);
  }

  closed(code) {
    if (code === REFUSED) return this.on.refused();
    this.queue = [];
    this.on.lost(`${WHY[code] ?? "The connection is lost"}; trying again…`);
    setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(LONGEST_WAIT, this.wait * 1.6);
  }

  get ready() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  now(message) {
    if (this.ready) this.socket.send(JSON.stringify(message));
  }

  /** To be sent with the next animation frame, after changes of the state. */
  later(message) {
    this.queue.push(message);
  }

  flush() {
    for (const message of this.queue.splice(0)) this.now(message);
  }
}
