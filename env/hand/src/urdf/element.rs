//! The elements of an XML file with their lines; what they mean is not known here.

use std::ops::Range;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use crate::error::{ProblemKind, Report};

/// Largest nesting depth; a URDF needs 5 (robot, link, collision, geometry, box), extensions of simulators a few more.
const MAX_DEPTH: usize = 32;

/// Most attributes of an element; an `<inertia>` has 6. They are compared with each other.
const MAX_ATTRIBUTES: usize = 64;

/// An element, with what is in it; texts and comments are left out.
#[derive(Debug, Default)]
pub(crate) struct Element {
    /// Its name, with its prefix: prefixes need not be declared.
    pub name: String,
    /// Line of its start tag, from 1.
    pub line: usize,
    /// Bytes of the text from its start tag to its end tag.
    pub span: Range<usize>,
    attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
}

impl Element {
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// Names and values of all attributes.
    pub fn attributes(&self) -> impl Iterator<Item = (&str, &str)> {
        self.attributes.iter().map(|(name, value)| (name.as_str(), value.as_str()))
    }

    /// The first child of a name.
    pub fn child(&self, name: &str) -> Option<&Element> {
        self.all(name).next()
    }

    /// The children of a name.
    pub fn all(&self, name: &str) -> impl Iterator<Item = &Element> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// The numbers of an attribute; `None` where it is missing or has others than `N` numbers.
    pub fn numbers<const N: usize>(&self, attribute: &str) -> Option<[f64; N]> {
        let numbers: Option<Vec<f64>> =
            self.attribute(attribute)?.split_whitespace().map(|word| word.parse().ok()).collect();
        numbers?.try_into().ok()
    }

    /// The number of an attribute; `default` where it has none.
    pub fn number(&self, attribute: &str, default: f64) -> f64 {
        self.numbers::<1>(attribute).map_or(default, |[number]| number)
    }
}

/// Lines of increasing bytes of a text.
struct Lines<'a> {
    text: &'a str,
    byte: usize,
    line: usize,
}

impl Lines<'_> {
    /// Line of a byte, from 1.
    fn of(&mut self, byte: usize) -> usize {
        let end = byte.clamp(self.byte, self.text.len());
        self.line += self.text.as_bytes()[self.byte..end].iter().filter(|byte| **byte == b'\n').count();
        self.byte = end;
        self.line
    }
}

/// The root element; `None` and a problem where the text is no XML, or nested too deeply.
pub(crate) fn parse(text: &str, report: &mut Report<'_>) -> Option<Element> {
    if let Some(at) = text.find("<!DOCTYPE").or_else(|| text.find("<!ENTITY")) {
        report.add(1 + text[..at].matches('\n').count(), ProblemKind::Doctype);
        return None;
    }
    let (mut line, mut open, mut root) = (1, Vec::new(), None);
    match read(text, &mut line, &mut open, &mut root) {
        Ok(()) => root,
        Err(kind) => {
            report.add(line, kind);
            None
        }
    }
}

/// Reads all events; `line` is that of a problem.
fn read(text: &str, line: &mut usize, open: &mut Vec<Element>, root: &mut Option<Element>) -> Result<(), ProblemKind> {
    let mut reader = Reader::from_str(text);
    reader.config_mut().expand_empty_elements = true;
    let mut lines = Lines { text, byte: 0, line: 1 };
    loop {
        let start = bytes(reader.buffer_position());
        *line = lines.of(start);
        match reader.read_event() {
            Ok(Event::Start(tag)) => {
                if open.len() == MAX_DEPTH {
                    return Err(ProblemKind::TooDeep(MAX_DEPTH));
                }
                if open.is_empty() && root.is_some() {
                    return Err(ProblemKind::Xml("there is a second root element".to_owned()));
                }
                open.push(element(&tag, *line, start)?);
            }
            Ok(Event::End(_)) => {
                let Some(mut done) = open.pop() else { continue };
                done.span.end = bytes(reader.buffer_position());
                match open.last_mut() {
                    Some(parent) => parent.children.push(done),
                    None => *root = Some(done),
                }
            }
            Ok(Event::Eof) => break,
            Ok(_) => {}
            Err(error) => {
                *line = lines.of(bytes(reader.error_position()));
                return Err(ProblemKind::Xml(one_line(&error.to_string())));
            }
        }
    }
    if let Some(unfinished) = open.last() {
        *line = unfinished.line;
        return Err(ProblemKind::Xml(format!("the element <{}> is not closed", unfinished.name)));
    }
    if root.is_none() {
        return Err(ProblemKind::Xml("there is no element".to_owned()));
    }
    Ok(())
}

fn bytes(position: u64) -> usize {
    usize::try_from(position).unwrap_or(usize::MAX)
}

fn element(tag: &BytesStart<'_>, line: usize, start: usize) -> Result<Element, ProblemKind> {
    let wrong = |error: &dyn std::fmt::Display| ProblemKind::Xml(one_line(&error.to_string()));
    let mut attributes = Vec::new();
    for attribute in tag.attributes() {
        if attributes.len() == MAX_ATTRIBUTES {
            return Err(ProblemKind::Xml(format!("an element has more than {MAX_ATTRIBUTES} attributes")));
        }
        let attribute = attribute.map_err(|error| wrong(&error))?;
        let value = attribute.unescape_value().map_err(|error| wrong(&error))?;
        attributes.push((String::from_utf8_lossy(attribute.key.as_ref()).into_owned(), value.into_owned()));
    }
    let name = String::from_utf8_lossy(tag.name().as_ref()).into_owned();
    Ok(Element { name, line, span: start..start, attributes, children: Vec::new() })
}

/// A message without line breaks.
fn one_line(text: &str) -> String {
    text.lines().map(str::trim).collect::<Vec<_>>().join("; ")
}
