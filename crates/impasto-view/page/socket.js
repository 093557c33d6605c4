// The socket: messages as objects, pictures with their heads read, and a connection that comes
// back by itself.

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 8000;
const HEAD = 32;

// The head of a picture, as docs/studio.md lays it out.
export function parseHead(buffer) {
  const head = new DataView(buffer, 0, HEAD);
  return {
    frame: head.getUint32(0, true),
    view: head.getUint32(4, true),
    coats: head.getUint32(8, true),
    x: head.getUint16(12, true),
    y: head.getUint16(14, true),
    width: head.getUint16(16, true),
    height: head.getUint16(18, true),
    viewWidth: head.getUint16(20, true),
    viewHeight: head.getUint16(22, true),
    level: head.getUint8(24),
    last: head.getUint8(25) === 1,
    milliseconds: head.getUint16(26, true),
    rays: head.getUint32(28, true),
  };
}

export class Socket {
  // `listeners`: opened(), lost(seconds until it tries again), message(object), picture(head, blob).
  constructor(listeners) {
    this.listeners = listeners;
    this.attempts = 0;
    this.timer = 0;
    this.id = 0;
    this.socket = null;
  }

  get open() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  connect() {
    clearTimeout(this.timer);
    if (this.socket && this.socket.readyState <= WebSocket.OPEN) return;
    const address = new URL("/api/stream", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.attempts = 0;
      this.listeners.opened();
    };
    socket.onmessage = ({ data }) => this.receive(data);
    socket.onclose = () => {
      if (this.socket === socket) this.wait();
    };
    this.socket = socket;
  }

  receive(data) {
    if (typeof data === "string") {
      this.listeners.message(JSON.parse(data));
    } else if (data.byteLength > HEAD) {
      const jpeg = new Blob([new Uint8Array(data, HEAD)], { type: "image/jpeg" });
      this.listeners.picture(parseHead(data), jpeg);
    }
  }

  wait() {
    const longest = Math.min(LONGEST_WAIT_MS, FIRST_WAIT_MS * 2 ** this.attempts);
    this.attempts += 1;
    // Many pages must not come back in the same moment.
    const delay = longest * (0.75 + Math.random() / 4);
    this.listeners.lost(delay / 1000);
    this.timer = setTimeout(() => this.connect(), delay);
  }

  // Sends a message under a new id, and returns that; 0 if there is no connection. Views, coats and
  // picks count together, so that a problem's id is about one of them only.
  send(message) {
    if (!this.open) return 0;
    this.id += 1;
    this.socket.send(JSON.stringify({ id: this.id, ...message }));
    return this.id;
  }

  acknowledge(frame) {
    if (this.open) this.socket.send(JSON.stringify({ type: "ack", frame }));
  }

  watch(on) {
    if (this.open) this.socket.send(JSON.stringify({ type: "watch", on }));
  }
}
