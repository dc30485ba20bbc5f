//! Frames: values, their codec, and their contents.
//!
//! | module | contents |
//! |---|---|
//! | [`value`], [`mod@decode`], [`encode`] | the codec: values, reading within bounds, writing |
//! | [`fault`] | errors as sent to a client |
//! | [`fields`], [`command`] | commands of a client, one row each |
//! | [`answer`] | results of environments as frames |

pub mod answer;
pub mod command;
pub mod decode;
pub mod encode;
pub mod fault;
pub mod fields;
pub mod value;
