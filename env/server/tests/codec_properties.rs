//! Values are read as they were written; other input is refused within bounds.

#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "../fuzz/bodies.rs"]
mod bodies;

use graspbox_server::gate::Gate;
use graspbox_server::wire::value::{Dtype, MAX_DEPTH, MAX_VALUES, NdArray};
use graspbox_server::{CodecError, Encoder, Value, decode};
use http::{HeaderMap, HeaderValue};
use proptest::collection::vec;
use proptest::prelude::*;

/// A value that owns its parts.
#[derive(Clone, Debug)]
enum Tree {
    Nil,
    Bool(bool),
    Integer(i128),
    Float(f64),
    Text(String),
    Bytes(Vec<u8>),
    List(Vec<Tree>),
    Map(Vec<(String, Tree)>),
    Array(Dtype, Vec<usize>, Vec<u8>),
}

impl Tree {
    fn value(&self) -> Value<'_> {
        match self {
            Self::Nil => Value::Nil,
            Self::Bool(flag) => Value::Bool(*flag),
            Self::Integer(number) => Value::Integer(*number),
            Self::Float(number) => Value::Float(*number),
            Self::Text(text) => Value::Text(text),
            Self::Bytes(bytes) => Value::Bytes(bytes),
            Self::List(items) => Value::List(items.iter().map(Self::value).collect()),
            Self::Map(entries) => Value::Map(entries.iter().map(|(key, tree)| (key.as_str(), tree.value())).collect()),
            Self::Array(dtype, shape, data) => Value::Array(NdArray { dtype: *dtype, shape: shape.clone(), data }),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut frame = Encoder::default();
        bodies::write(&mut frame, &self.value());
        frame.into_bytes()
    }
}

fn array() -> impl Strategy<Value = Tree> {
    (0..Dtype::ALL.len(), vec(0..4_usize, 0..4)).prop_flat_map(|(index, shape)| {
        let dtype = Dtype::ALL[index];
        let count = dtype.size() * shape.iter().product::<usize>();
        vec(any::<u8>(), count).prop_map(move |data| Tree::Array(dtype, shape.clone(), data))
    })
}

fn tree() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![
        Just(Tree::Nil),
        any::<bool>().prop_map(Tree::Bool),
        any::<i64>().prop_map(|n| Tree::Integer(n.into())),
        any::<u64>().prop_map(|n| Tree::Integer(n.into())),
        any::<f64>().prop_map(Tree::Float),
        ".{0,40}".prop_map(Tree::Text),
        vec(any::<u8>(), 0..300).prop_map(Tree::Bytes),
        array(),
    ];
    leaf.prop_recursive(6, 64, 8, |inner| {
        prop_oneof![
            vec(inner.clone(), 0..8).prop_map(Tree::List),
            vec(("[a-z]{0,8}", inner), 0..8).prop_map(Tree::Map),
        ]
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn what_is_written_is_read(tree in tree()) {
        let bytes = tree.bytes();
        prop_assert_eq!(decode(&bytes).unwrap(), tree.value());
    }

    #[test]
    fn a_frame_that_is_cut_off_is_refused(tree in tree(), at in any::<prop::sample::Index>()) {
        let bytes = tree.bytes();
        let short = decode(&bytes[..at.index(bytes.len())]);
        prop_assert!(short.is_err(), "{:?}", short);
    }

    #[test]
    fn a_frame_that_goes_on_is_refused(tree in tree(), more in vec(any::<u8>(), 1..50)) {
        let bytes = [tree.bytes(), more.clone()].concat();
        prop_assert_eq!(decode(&bytes), Err(CodecError::Long { extra: more.len() }));
    }

    #[test]
    fn flipped_bits_break_nothing(tree in tree(), flips in vec((any::<prop::sample::Index>(), 0..8_u8), 1..6)) {
        let mut bytes = tree.bytes();
        for (at, bit) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        bodies::decode(&bytes);
        bodies::request(&bytes);
    }

    #[test]
    fn spliced_frames_break_nothing(one in tree(), two in tree(), at in any::<prop::sample::Index>()) {
        let (one, two) = (one.bytes(), two.bytes());
        let at = at.index(one.len());
        bodies::decode(&[&one[..at], &two[..]].concat());
        bodies::decode(&[&two[..two.len().min(at)], &one[at..]].concat());
    }

    #[test]
    fn arbitrary_bytes_break_nothing(bytes in vec(any::<u8>(), 0..2000)) {
        bodies::decode(&bytes);
        bodies::request(&bytes);
        bodies::gate(&bytes);
    }

    #[test]
    fn fields_of_any_kind_are_read_or_refused(
        row in 0..graspbox_server::wire::command::COMMANDS.len(),
        fields in vec(tree(), 9),
        id in prop_oneof![Just(Tree::Integer(7)), tree()],
    ) {
        let (command, names, _) = graspbox_server::wire::command::COMMANDS[row];
        let mut entries = vec![("id".to_owned(), id), ("command".to_owned(), Tree::Text(command.to_owned()))];
        entries.extend(names.iter().map(|name| (*name).to_owned()).zip(fields));
        bodies::request(&Tree::Map(entries).bytes());
    }

    #[test]
    fn a_token_opens_only_for_its_owner(token in "[!-~]{16,40}", other in "[!-~]{0,40}", scheme in 0..3_usize) {
        let gate = Gate::new(Some(&token), &[]);
        let given = |text: &str| {
            let mut headers = HeaderMap::new();
            let (name, value) = match scheme {
                0 => ("authorization", format!("Bearer {text}")),
                1 => ("authorization", format!("Api-Key {text}")),
                _ => ("sec-websocket-protocol", format!("graspbox, graspbox.token.{text}")),
            };
            headers.insert(name, HeaderValue::from_str(&value).unwrap());
            gate.admits(&headers)
        };
        // A subprotocol holds no comma.
        if scheme < 2 || !token.contains(',') {
            prop_assert_eq!(given(&token), Ok(()));
        }
        if other != token {
            prop_assert_eq!(given(&other), Err("token"));
            prop_assert_eq!(given(&format!("{token} ").replace(' ', "x")), Err("token"));
        }
    }
}

fn is_array_error(bytes: &[u8], words: &str) -> bool {
    matches!(decode(bytes), Err(CodecError::Array { why }) if why.contains(words))
}

fn array_frame(dtype: &str, shape: &[u64], data: &[u8]) -> Vec<u8> {
    let mut frame = Encoder::default();
    frame.map(4);
    frame.text("__ndarray__");
    frame.boolean(true);
    frame.text("dtype");
    frame.text(dtype);
    frame.text("shape");
    frame.list(shape.len());
    shape.iter().for_each(|n| frame.unsigned(*n));
    frame.text("data");
    frame.binary(data);
    frame.into_bytes()
}

#[test]
fn depth_is_bounded() {
    let nested = |depth: usize| [vec![0x91; depth], vec![0xc0]].concat();
    assert!(decode(&nested(MAX_DEPTH)).is_ok());
    assert_eq!(decode(&nested(MAX_DEPTH + 1)), Err(CodecError::Deep));
    assert_eq!(decode(&nested(1_000_000)), Err(CodecError::Deep));
    let maps = [[0x81, 0xa1, b'k'].repeat(MAX_DEPTH + 1), vec![0xc0]].concat();
    assert_eq!(decode(&maps), Err(CodecError::Deep));
}

#[test]
fn values_are_counted() {
    let list = |count: usize| [vec![0xdd], (count as u32).to_be_bytes().to_vec(), vec![0xc0; count]].concat();
    assert!(decode(&list(MAX_VALUES - 1)).is_ok());
    assert_eq!(decode(&list(MAX_VALUES)), Err(CodecError::Many));
    assert_eq!(decode(&list(1_000_000)), Err(CodecError::Many));
    // Keys count, and so do values in several lists.
    let entries = [0xa0, 0xc0].repeat(MAX_VALUES / 2);
    let map = [vec![0xdf], ((MAX_VALUES / 2) as u32).to_be_bytes().to_vec(), entries].concat();
    assert_eq!(decode(&map), Err(CodecError::Many));
    assert_eq!(decode(&[vec![0x92], list(150_000), list(150_000)].concat()), Err(CodecError::Many));
}

#[test]
fn announced_lengths_are_checked_against_the_frame() {
    for marker in [0xc6, 0xdb, 0xdd, 0xdf] {
        let bytes = [vec![marker], vec![0xff; 4], vec![0xc0; 9]].concat();
        let refused = if marker == 0xdf {
            CodecError::NotText { what: "a key of a map" }
        } else {
            CodecError::Short { length: 14 }
        };
        assert_eq!(decode(&bytes), Err(refused), "{marker:#x}");
    }
    assert_eq!(decode(&[]), Err(CodecError::Short { length: 0 }));
}

#[test]
fn markers_that_are_not_used_are_refused() {
    for marker in [0xc1, 0xc7, 0xc8, 0xc9, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8] {
        assert_eq!(decode(&[marker, 0, 0, 0]), Err(CodecError::Unused { marker }));
    }
    assert_eq!(decode(&[0xa1, 0xff]), Err(CodecError::NotText { what: "a text" }));
    assert_eq!(decode(&[0x81, 0x01, 0x01]), Err(CodecError::NotText { what: "a key of a map" }));
}

#[test]
fn arrays_are_what_they_say() {
    assert!(decode(&array_frame("<f4", &[2, 3], &[0; 24])).is_ok());
    assert!(decode(&array_frame("<f4", &[0, 1 << 60], &[])).is_ok());
    // numpy makes no such array, and the thread that asked it for one ended.
    for shape in [[0, 1 << 62], [1 << 62, 0], [0, u64::MAX]] {
        assert!(is_array_error(&array_frame("<f4", &shape, &[]), "bytes of data"), "{shape:?}");
    }
    for dtype in ["|O", ">f4", "<c8", "<U4", "|V8", "<f2", "float32", "<M8[ns]", ""] {
        assert!(is_array_error(&array_frame(dtype, &[1], &[0; 4]), "little-endian"), "{dtype}");
    }
    let wrong: [(&[u64], usize); 6] = [
        (&[2, 3], 23),
        (&[2, 3], 25),
        (&[u64::MAX, u64::MAX], 0),
        (&[1 << 62, 4], 0),
        (&[1 << 63, 2, 0, 1], 4),
        (&[1], 0),
    ];
    for (shape, bytes) in wrong {
        assert!(is_array_error(&array_frame("<f4", shape, &vec![0; bytes]), "bytes of data"), "{shape:?}");
    }
    assert!(decode(&array_frame("|u1", &[1; 32], &[0])).is_ok());
    assert!(is_array_error(&array_frame("|u1", &[1; 33], &[0]), "33 axes"));
    let long = "x".repeat(100_000);
    assert!(matches!(decode(&array_frame(&long, &[1], &[0])), Err(CodecError::Array { why }) if why.len() < 200));
}
