// A client of `graspbox serve` in a browser: numbers commands, waits for answers, resumes its session after a lost connection.

import { decode, encode } from "./msgpack.js";

const GRACE = 30;
const PAUSE = 500;
/** Code with which the server closes a connection whose session is over. */
const OVER = 4000;

export class Client {
  #socket = null;
  #next = 1;
  #seen = 0;
  #waiting = new Map();
  #ticket = null;
  #closed = false;

  constructor(url, token) {
    this.url = url;
    // Browsers cannot set the header Authorization, so the token travels as a subprotocol.
    this.protocols = ["graspbox", ...(token ? [`graspbox.token.${token}`] : [])];
  }

  /** Connects; the first frame of the server is in `hello` then. */
  static async connect(url, token = "") {
    const client = new Client(url, token);
    await client.#open();
    if (client.hello.protocol !== "graspbox" || client.hello.protocol_version !== 1) {
      client.close();
      throw new Error(`${url} is no server of environments that this page understands`);
    }
    return client;
  }

  #open() {
    return new Promise((opened, failed) => {
      const socket = new WebSocket(this.url, this.protocols);
      socket.binaryType = "arraybuffer";
      socket.onerror = () => failed(new Error(
        `${this.url} cannot be reached: is the server running, is the token right, and does it allow this page ` +
        `(graspbox serve --origin ${location.origin})?`));
      socket.onmessage = ({ data }) => {
        this.hello = decode(new Uint8Array(data));
        this.#socket = socket;
        socket.onmessage = (event) => this.#take(decode(new Uint8Array(event.data)));
        // Only the server ends a session; a proxy that goes away may say why, too.
        socket.onclose = (event) => this.#lost(event.code === OVER ? event.reason : "");
        opened();
      };
    });
  }

  /** Sends a command; resolves to its answer, or fails with the error of the server. */
  call(command, fields = {}) {
    if (this.#closed) return Promise.reject(new Error("the connection is closed"));
    const id = this.#next++;
    const frame = encode({ id, command, seen: this.#seen, ...fields });
    return new Promise((resolve, reject) => {
      this.#waiting.set(id, { frame, resolve, reject });
      if (this.#socket?.readyState === WebSocket.OPEN) this.#socket.send(frame);
    });
  }

  #take(answer) {
    if (answer.secret !== undefined) this.#ticket = { session: answer.session, secret: answer.secret };
    const asked = this.#waiting.get(answer.id);
    this.#waiting.delete(answer.id);
    this.#seen = Math.max(this.#seen, answer.id ?? 0);
    if (answer.error === undefined) asked?.resolve(answer);
    else if (asked) asked.reject(Object.assign(new Error(answer.error.message), { type: answer.error.type }));
    else this.#fail(new Error(answer.error.message));
  }

  /** The connection broke off: takes the session up again, and sends the messages that the server has not received. */
  async #lost(reason) {
    this.#socket = null;
    if (this.#closed) return;
    const until = Date.now() + 1000 * GRACE;
    while (this.#ticket !== null && reason === "" && Date.now() < until) {
      try {
        await this.#open();
        return this.#resume();
      } catch {
        await new Promise((done) => setTimeout(done, PAUSE));
      }
    }
    this.#fail(new Error(`the session on ${this.url} is over: ${reason || "the connection broke off"}`));
  }

  #resume() {
    const asked = { id: 0, command: "resume", ...this.#ticket, received: this.#seen };
    this.#waiting.set(0, {
      resolve: ({ received }) => {
        for (const [id, { frame }] of this.#waiting) if (id > received) this.#socket.send(frame);
      },
      reject: (error) => this.#fail(error),
    });
    this.#socket.send(encode(asked));
  }

  /** The connection breaks off, as a network would do it: for tests. */
  breakOff() {
    this.#socket?.close();
  }

  #fail(error) {
    this.#closed = true;
    for (const { reject } of this.#waiting.values()) reject(error);
    this.#waiting.clear();
  }

  /** Ends the session. */
  close() {
    if (this.#socket?.readyState === WebSocket.OPEN && !this.#closed) {
      this.#socket.send(encode({ id: this.#next++, command: "close" }));
      this.#socket.close();
    }
    this.#fail(new Error("the connection is closed"));
  }

  get grace() {
    return Math.min(GRACE, this.hello.limits.max_grace);
  }
}
