//! An agent acts: many environments side by side, each an [`Episode`](crate::Episode) driven by actions at 20 Hz.
//!
//! | module | what it does |
//! |---|---|
//! | [`config`] | how the environments are steered, ended and varied |
//! | [`objects`] | objects that are prepared at their first use and shared by every environment |
//! | [`draw`] | the random stream of one environment |
//! | [`start`] | how an episode begins: drawn, or as asked |
//! | [`action`] | what the numbers of an action mean |
//! | [`servo`] | moves the hand within its limits |
//! | [`guard`] | keeps the hand off the table and stops it where it presses too hard |
//! | [`layout`] | the tables of observations: names, bounds, units |
//! | [`observe`] | fills observations |
//! | [`closure`] | how well the present contacts hold the object |
//! | [`reward`] | named reward terms |
//! | [`rules`] | what every environment of a pool shares |
//! | [`play`] | one episode under an agent |
//! | [`slot`] | one environment: its stream, its episode, its state as bytes |
//! | [`batch`] | what a step of many environments showed, as flat arrays |
//! | [`pool`] | all environments in one call |
//!
//! Every random draw depends on the environment's own stream alone, so results depend neither on the number of environments
//! nor on the number of threads.

pub mod action;
pub mod batch;
pub mod closure;
pub mod config;
pub mod draw;
pub mod guard;
pub mod layout;
pub mod objects;
pub mod observe;
pub mod play;
pub mod pool;
pub mod reward;
pub mod rules;
pub mod servo;
pub mod slot;
pub mod start;

pub use action::Control;
pub use batch::Batch;
pub use config::{AgentConfig, Autoreset, Randomization};
pub use layout::{Field, Observation};
pub use objects::{Objects, Source};
pub use play::Info;
pub use pool::{Pool, panic_text};
pub use rules::Rules;
pub use slot::{Outcome, Slot};
pub use start::StartOptions;
