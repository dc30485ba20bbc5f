//! Bodies of the fuzz targets: plain functions, which tests call too. They panic where the server is wrong.

use graspbox_server::gate::Gate;
use graspbox_server::wire::command::Request;
use graspbox_server::{Encoder, Value, decode as read};
use http::{HeaderMap, HeaderName, HeaderValue};

/// The token of the gate.
pub const TOKEN: &str = "a-token-of-many-characters";
/// An origin that it lets in.
pub const ORIGIN: &str = "http://page.example";

/// Writes a value as a client would.
pub fn write(frame: &mut Encoder, value: &Value<'_>) {
    match value {
        Value::Nil => frame.nil(),
        Value::Bool(flag) => frame.boolean(*flag),
        Value::Integer(number) => match i64::try_from(*number) {
            Ok(number) => frame.integer(number),
            Err(_) => frame.unsigned(u64::try_from(*number).expect("integers have 64 bits")),
        },
        Value::Float(number) => frame.float(*number),
        Value::Text(text) => frame.text(text),
        Value::Bytes(bytes) => frame.binary(bytes),
        Value::List(items) => {
            frame.list(items.len());
            items.iter().for_each(|item| write(frame, item));
        }
        Value::Map(entries) => {
            frame.map(entries.len());
            for (key, value) in entries {
                frame.text(key);
                write(frame, value);
            }
        }
        Value::Array(array) => frame.array_bytes(array.dtype, &array.shape, array.data),
        Value::Shared(array) => {
            frame.map(3);
            frame.text("__shm__");
            frame.unsigned(array.offset);
            frame.text("dtype");
            frame.text(array.dtype.name());
            frame.text("shape");
            frame.list(array.shape.len());
            array.shape.iter().for_each(|n| frame.unsigned(*n as u64));
        }
    }
}

/// A value that can be read is the same after it was written and read again.
pub fn decode(data: &[u8]) {
    let Ok(value) = read(data) else { return };
    let mut frame = Encoder::default();
    write(&mut frame, &value);
    let bytes = frame.into_bytes();
    let again = read(&bytes).expect("what the codec wrote can be read");
    // As text, since a number that is none differs from itself.
    assert_eq!(format!("{value:?}"), format!("{again:?}"));
}

/// A command is read or refused with a sentence of bounded length, under the number that it gave.
pub fn request(data: &[u8]) {
    let Ok(value) = read(data) else { return };
    match Request::parse(&value) {
        Ok(request) => assert_eq!(value.get("id"), Some(&Value::Integer(request.id.into()))),
        Err((id, fault)) => {
            assert!(id.is_none_or(|id| value.get("id") == Some(&Value::Integer(id.into()))));
            assert_eq!(fault.kind, "ConfigError");
            assert!(fault.field.len() <= 200, "{} bytes of a field", fault.field.len());
            assert!(fault.message.len() <= 16_384, "{} bytes of a message", fault.message.len());
        }
    }
}

/// Nobody comes in without the token, and no page of an origin that is not named: lines `NUMBER VALUE`, a header each.
pub fn gate(data: &[u8]) {
    const NAMES: [&str; 5] = ["authorization", "origin", "host", "sec-websocket-protocol", "cookie"];
    let mut headers = HeaderMap::new();
    for line in data.split(|byte| *byte == b'\n') {
        if let Some((first, rest)) = line.split_first()
            && let Ok(value) = HeaderValue::from_bytes(rest)
        {
            headers.append(HeaderName::from_static(NAMES[usize::from(*first) % NAMES.len()]), value);
        }
    }
    let holds = |text: &str, name: &str| {
        headers
            .get_all(name)
            .iter()
            .any(|value| value.as_bytes().windows(text.len()).any(|part| part == text.as_bytes()))
    };
    let known = holds(TOKEN, "authorization") || holds(TOKEN, "sec-websocket-protocol");
    let local = ["localhost", "127.0.0.1", "[::1]"].into_iter().any(|name| holds(name, "origin"));
    let page = !headers.contains_key("origin") || holds(ORIGIN, "origin") || local;
    let gate = Gate::new(Some(TOKEN), &[ORIGIN.to_owned()]);
    assert!(gate.admits(&headers).is_err() || (known && page));
    assert!(Gate::new(None, &[]).admits(&headers).is_err() || local || !headers.contains_key("origin"));
}
