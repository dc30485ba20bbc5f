// msgpack, and numpy arrays as openpi's clients write them: the subset that graspbox's protocol needs.
//
// Integers beyond 2^53, such as the secret of a session, are BigInt on both sides; all others are Number.

const TYPES = {
  "|b1": Uint8Array, "|u1": Uint8Array, "|i1": Int8Array, "<u2": Uint16Array, "<i2": Int16Array, "<u4": Uint32Array,
  "<i4": Int32Array, "<u8": BigUint64Array, "<i8": BigInt64Array, "<f4": Float32Array, "<f8": Float64Array,
};
const DEEPEST = 32;
const text = { encode: new TextEncoder(), decode: new TextDecoder("utf-8", { fatal: true }) };

/** A numpy array in C order: `data` is the typed array of its dtype. */
export class NdArray {
  constructor(dtype, shape, data) {
    Object.assign(this, { dtype, shape, data });
  }

  static float32(rows) {
    return new NdArray("<f4", [rows.length, rows[0].length], Float32Array.from(rows.flat()));
  }
}

class Writer {
  constructor() {
    this.bytes = new Uint8Array(1024);
    this.length = 0;
  }

  /** Room for `count` bytes; where it begins. */
  room(count) {
    const at = this.length;
    this.length += count;
    if (this.length > this.bytes.length) {
      const larger = new Uint8Array(Math.max(2 * this.bytes.length, this.length));
      larger.set(this.bytes.subarray(0, at));
      this.bytes = larger;
    }
    return at;
  }

  /** A marker and a big-endian number of `size` bytes behind it. */
  number(marker, size, method, value) {
    const at = this.room(1 + size);
    const view = new DataView(this.bytes.buffer);
    view.setUint8(at, marker);
    view[method](at + 1, value);
  }

  raw(bytes) {
    const at = this.room(bytes.length);
    this.bytes.set(bytes, at);
  }

  /** Text, bytes, a list or a map of a length: the shortest of its forms, [marker, size, most] each. */
  head(length, forms) {
    const [marker, size] = forms.find(([, , most]) => length <= most);
    if (size === 0) this.raw([marker | length]);
    else this.number(marker, size, { 1: "setUint8", 2: "setUint16", 4: "setUint32" }[size], length);
  }

  text(value) {
    const bytes = text.encode.encode(value);
    this.head(bytes.length, [[0xa0, 0, 31], [0xd9, 1, 0xff], [0xda, 2, 0xffff], [0xdb, 4, 0xffffffff]]);
    this.raw(bytes);
  }

  binary(bytes) {
    this.head(bytes.length, [[0xc4, 1, 0xff], [0xc5, 2, 0xffff], [0xc6, 4, 0xffffffff]]);
    this.raw(bytes);
  }

  list(length) {
    this.head(length, [[0x90, 0, 15], [0xdc, 2, 0xffff], [0xdd, 4, 0xffffffff]]);
  }

  map(length) {
    this.head(length, [[0x80, 0, 15], [0xde, 2, 0xffff], [0xdf, 4, 0xffffffff]]);
  }

  integer(value) {
    if (value >= 0 && value < 128) this.raw([Number(value)]);
    else if (value < 0) this.number(0xd3, 8, "setBigInt64", BigInt(value));
    else this.number(0xcf, 8, "setBigUint64", BigInt(value));
  }

  array({ dtype, shape, data }) {
    this.map(4);
    const entries = { __ndarray__: true, data: new Uint8Array(data.buffer, data.byteOffset, data.byteLength), dtype, shape };
    for (const [name, value] of Object.entries(entries)) {
      this.binary(text.encode.encode(name));
      this.value(value);
    }
  }

  value(value) {
    if (value === null || value === undefined) this.raw([0xc0]);
    else if (typeof value === "boolean") this.raw([value ? 0xc3 : 0xc2]);
    else if (typeof value === "bigint" || Number.isSafeInteger(value)) this.integer(value);
    else if (typeof value === "number") this.number(0xcb, 8, "setFloat64", value);
    else if (typeof value === "string") this.text(value);
    else if (value instanceof Uint8Array) this.binary(value);
    else if (value instanceof NdArray) this.array(value);
    else if (Array.isArray(value)) {
      this.list(value.length);
      value.forEach((item) => this.value(item));
    } else {
      const entries = Object.entries(value);
      this.map(entries.length);
      entries.forEach(([name, item]) => (this.text(name), this.value(item)));
    }
  }
}

class Reader {
  constructor(bytes) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.at = 0;
  }

  take(count) {
    if (count > this.bytes.length - this.at) throw new Error(`the frame ends after ${this.bytes.length} bytes`);
    this.at += count;
    return this.bytes.subarray(this.at - count, this.at);
  }

  /** A big-endian number. */
  number(method, size) {
    const at = this.at;
    this.take(size);
    const value = this.view[method](at);
    return typeof value === "bigint" && Number.isSafeInteger(Number(value)) ? Number(value) : value;
  }

  count(marker, first) {
    const size = 1 << (marker - first);
    return this.number({ 1: "getUint8", 2: "getUint16", 4: "getUint32" }[size], size);
  }

  list(length, depth) {
    const items = [];
    for (let i = 0; i < length; i++) items.push(this.value(depth));
    return items;
  }

  map(length, depth) {
    const entries = [];
    for (let i = 0; i < length; i++) {
      const key = this.value(depth);
      entries.push([key instanceof Uint8Array ? text.decode.decode(key) : key, this.value(depth)]);
    }
    const map = Object.fromEntries(entries);
    if (map.__npgeneric__ === true) return map.data;
    if (map.__ndarray__ !== true) return map;
    const Typed = TYPES[map.dtype];
    if (Typed === undefined) throw new Error(`an array has the dtype ${map.dtype}`);
    // A copy: typed arrays begin at multiples of their size.
    return new NdArray(map.dtype, map.shape, new Typed(map.data.slice().buffer));
  }

  value(depth = 0) {
    if (depth > DEEPEST) throw new Error("values are nested too deeply");
    const marker = this.take(1)[0];
    if (marker < 0x80) return marker;
    if (marker >= 0xe0) return marker - 256;
    if (marker < 0x90) return this.map(marker & 0x0f, depth + 1);
    if (marker < 0xa0) return this.list(marker & 0x0f, depth + 1);
    if (marker < 0xc0) return text.decode.decode(this.take(marker & 0x1f));
    if (marker >= 0xc4 && marker <= 0xc6) return this.take(this.count(marker, 0xc4));
    if (marker >= 0xd9 && marker <= 0xdb) return text.decode.decode(this.take(this.count(marker, 0xd9)));
    switch (marker) {
      case 0xc0: return null;
      case 0xc2: return false;
      case 0xc3: return true;
      case 0xca: return this.number("getFloat32", 4);
      case 0xcb: return this.number("getFloat64", 8);
      case 0xcc: return this.number("getUint8", 1);
      case 0xcd: return this.number("getUint16", 2);
      case 0xce: return this.number("getUint32", 4);
      case 0xcf: return this.number("getBigUint64", 8);
      case 0xd0: return this.number("getInt8", 1);
      case 0xd1: return this.number("getInt16", 2);
      case 0xd2: return this.number("getInt32", 4);
      case 0xd3: return this.number("getBigInt64", 8);
      case 0xdc: return this.list(this.number("getUint16", 2), depth + 1);
      case 0xdd: return this.list(this.number("getUint32", 4), depth + 1);
      case 0xde: return this.map(this.number("getUint16", 2), depth + 1);
      case 0xdf: return this.map(this.number("getUint32", 4), depth + 1);
      default: throw new Error(`the frame holds msgpack type 0x${marker.toString(16)}, which is not used here`);
    }
  }
}

/** A value as the bytes of a frame. */
export function encode(value) {
  const writer = new Writer();
  writer.value(value);
  return writer.bytes.subarray(0, writer.length);
}

/** The value of a frame. */
export function decode(bytes) {
  const reader = new Reader(bytes);
  const value = reader.value();
  if (reader.at !== bytes.length) throw new Error(`${bytes.length - reader.at} bytes follow the value`);
  return value;
}
