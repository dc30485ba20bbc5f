//! Configs from JSON values; errors name the invalid field, its value and the accepted ones.
//!
//! serde reports the expected type, and [`serde_path_to_error`] its path; the value is looked up in the JSON.

use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_path_to_error::{Path, Segment};

/// Greatest length of a value in an error, characters.
const SHOWN: usize = 60;
/// Least similarity (Jaro-Winkler) of a suggested name.
const ALIKE: f64 = 0.75;

/// An invalid config: a sentence that names the field.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct BadConfig(String);

/// A config from its JSON text; errors name it `what`.
///
/// # Errors
/// `TrialConfig.lift_height is 'x' (str); give a number`.
pub fn config<T: DeserializeOwned>(text: &str, what: &str) -> Result<T, BadConfig> {
    let value = serde_json::from_str(text).map_err(|error| BadConfig(format!("{what} is not JSON: {error}")))?;
    config_of(&value, what)
}

/// As [`config`], from parsed JSON.
///
/// # Errors
/// As [`config`].
pub fn config_of<T: DeserializeOwned>(value: &Value, what: &str) -> Result<T, BadConfig> {
    serde_path_to_error::deserialize(value)
        .map_err(|error| BadConfig(error_sentence(what, value, error.path(), &error.inner().to_string())))
}

/// The sentence for serde's error about the value at `path`.
fn error_sentence(what: &str, root: &Value, path: &Path, said: &str) -> String {
    let (mut name, mut value, mut parent) = (what.to_owned(), Some(root), what.to_owned());
    for segment in path {
        let next = match segment {
            Segment::Map { key } => (format!("{name}.{key}"), value.and_then(|v| v.get(key))),
            Segment::Seq { index } => (format!("{name}[{index}]"), value.and_then(|v| v.get(index))),
            Segment::Enum { .. } | Segment::Unknown => continue,
        };
        parent = name;
        (name, value) = next;
    }
    if let Some((field, known)) = named(said, "unknown field `") {
        // The path of an unknown field ends with the field itself.
        let owner = if name.ends_with(&format!(".{field}")) { &parent } else { &name };
        return match nearest(field, &known) {
            Some(near) => format!("{owner} has no field '{field}'; did you mean '{near}'?"),
            None => format!("{owner} has no field '{field}'; its fields are {}", listed(&known)),
        };
    }
    if let Some((field, _)) = named(said, "missing field `") {
        return format!("{name} lacks the field '{field}'; give it");
    }
    let shown = value.map_or_else(|| "None".to_owned(), python);
    if let Some((_, known)) = named(said, "unknown variant `") {
        return format!("{name} is {shown}; give {}", choice(&known));
    }
    match said.split_once(", expected ") {
        Some((_, expected)) => format!("{name} is {shown}; give {}", wanted(expected)),
        None => format!("{name} is {shown}; {said}"),
    }
}

/// The name in backticks after `start`, and the names that serde lists after it.
fn named<'a>(said: &'a str, start: &str) -> Option<(&'a str, Vec<&'a str>)> {
    let mut quoted = said.strip_prefix(start)?.split('`');
    let name = quoted.next()?;
    Some((name, quoted.skip(1).step_by(2).collect()))
}

fn nearest<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    let alike = known.iter().map(|k| (strsim::jaro_winkler(name, k), *k));
    alike.filter(|(score, _)| *score > ALIKE).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, k)| k)
}

fn listed(names: &[&str]) -> String {
    names.iter().map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ")
}

fn choice(names: &[&str]) -> String {
    match names {
        [] => "nothing".to_owned(),
        [one] => format!("'{one}'"),
        [rest @ .., last] => format!("{} or '{last}'", listed(rest)),
    }
}

/// A value in Python's notation, truncated to [`SHOWN`] characters, with its type.
fn python(value: &Value) -> String {
    let (text, kind) = match value {
        Value::Null => return "None".to_owned(),
        Value::Bool(true) => return "True".to_owned(),
        Value::Bool(false) => return "False".to_owned(),
        Value::Number(number) => (number.to_string(), if number.is_f64() { "float" } else { "int" }),
        Value::String(text) => (format!("'{text}'"), "str"),
        Value::Array(_) => (value.to_string(), "list"),
        Value::Object(_) => (value.to_string(), "dict"),
    };
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}... ({kind})", &text[..end]),
        None => format!("{text} ({kind})"),
    }
}

/// The type that serde expected, in words for a user.
fn wanted(expected: &str) -> String {
    let length = |rest: &str| rest.split(|c: char| !c.is_ascii_digit()).find_map(|n| n.parse::<usize>().ok());
    match expected {
        "f64" | "f32" => "a number".to_owned(),
        "u64" | "usize" => "an integer that is not negative".to_owned(),
        "u32" => format!("an integer from 0 to {}", u32::MAX),
        "u16" => format!("an integer from 0 to {}", u16::MAX),
        "u8" => format!("an integer from 0 to {}", u8::MAX),
        "i64" | "isize" | "i32" => "an integer".to_owned(),
        "a boolean" => "True or False".to_owned(),
        "a string" | "string or map" | "variant identifier" => "a string".to_owned(),
        "a sequence" => "a list".to_owned(),
        "fewer elements in array" => "a shorter list".to_owned(),
        _ if expected.starts_with("struct ") || expected == "a map" => "a config, or a dict of its fields".to_owned(),
        _ if expected.starts_with("an array of length") || expected.starts_with("a tuple of size") => {
            format!("a list of {} values", length(expected).unwrap_or_default())
        }
        _ => expected.to_owned(),
    }
}
