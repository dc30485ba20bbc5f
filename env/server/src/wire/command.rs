//! The commands of a client: one row of [`COMMANDS`] each.

use crate::wire::fault::Fault;
use crate::wire::fields::{Fields, items, json, natural, wrong};
use crate::wire::value::Value;
use graspbox_gym::ResetOptions;
use graspbox_gym::json::{config, config_of};

/// Session options of a client.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SessionOptions {
    /// Number of environments.
    pub num_envs: usize,
    /// Depth images as uint16 millimetres.
    pub millimetres: bool,
    /// The client's number of the first environment, for errors.
    pub first: usize,
    /// Send large arrays through shared memory.
    pub shm: bool,
    /// Time for which the session waits for a lost connection, seconds.
    pub grace: f64,
}

/// Fields that every command may have.
const COMMON: [&str; 4] = ["id", "command", "seen", "shm"];

/// Reads the fields of a command.
type Parse = fn(&Fields<'_, '_>) -> Result<Command, Fault>;

/// Every command: its name, its fields, and their reader.
pub const COMMANDS: &[(&str, &[&str], Parse)] = &[
    (
        "make",
        &["environment", "num_envs", "vector", "objects", "keywords", "depth", "grace", "first_env", "share"],
        make,
    ),
    ("reset", &["seed", "mask", "options"], reset),
    ("step", &["actions"], |fields| {
        let (actions, width) = fields.rows("actions")?;
        Ok(Command::Step { actions, width })
    }),
    ("send", &["actions", "env_ids"], |fields| {
        let (actions, width) = fields.rows("actions")?;
        Ok(Command::Send { actions, width, envs: fields.indices("env_ids")? })
    }),
    ("recv", &["count"], |fields| Ok(Command::Recv { count: fields.index("count")? })),
    ("observe", &[], |_| Ok(Command::Observe)),
    ("render", &["env_ids"], |fields| Ok(Command::Render { envs: fields.indices("env_ids")? })),
    ("cameras", &[], |_| Ok(Command::Cameras)),
    ("get_state", &["env_id"], |fields| Ok(Command::GetState { env: fields.index("env_id")? })),
    ("set_state", &["env_id", "state"], |fields| {
        Ok(Command::SetState { env: fields.index("env_id")?, state: fields.bytes("state")?.to_vec() })
    }),
    ("resume", &["session", "secret", "received"], |fields| {
        let number = |name| Ok(fields.natural(name)?.unwrap_or_default());
        Ok(Command::Resume { session: number("session")?, secret: number("secret")?, received: number("received")? })
    }),
    ("prepare", &[], |_| Ok(Command::Prepare)),
    ("names", &[], |_| Ok(Command::Names)),
    ("close", &[], |_| Ok(Command::Close)),
    ("cancel", &[], |_| Ok(Command::Cancel)),
];

/// The seeds of a reset.
#[derive(Clone, Debug, PartialEq)]
pub enum Seeds {
    /// Streams continue; those that have not begun get a seed of the server.
    Continue,
    /// Of the first environment; the others' follow by ones.
    First(u64),
    /// One per environment; none continues its stream.
    Each(Vec<Option<u64>>),
}

#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Makes the environments of the session.
    Make {
        /// The whole request, for Python.
        request: serde_json::Value,
        asked: SessionOptions,
    },
    /// Begins episodes.
    Reset {
        seeds: Seeds,
        /// Mask of environments; none: all.
        mask: Option<Vec<bool>>,
        /// One for all environments, or one per environment.
        options: Vec<ResetOptions>,
    },
    /// Steps all environments.
    Step {
        /// Actions, one row per environment.
        actions: Vec<f32>,
        /// Numbers in a row.
        width: usize,
    },
    /// Steps environments in the background.
    Send {
        /// Actions, one row for each.
        actions: Vec<f32>,
        /// Numbers in a row.
        width: usize,
        /// Their numbers; none: all.
        envs: Option<Vec<usize>>,
    },
    /// Waits for environments that were sent.
    Recv { count: usize },
    /// All environments as they stand.
    Observe,
    /// Pictures.
    Render {
        /// Numbers of environments; none: all.
        envs: Option<Vec<usize>>,
    },
    /// Intrinsics and poses of the cameras.
    Cameras,
    /// The state of an environment.
    GetState { env: usize },
    /// Restores a state.
    SetState {
        /// Number of the environment.
        env: usize,
        state: Vec<u8>,
    },
    /// Resumes a session whose connection was lost, instead of this connection's session.
    Resume {
        session: u64,
        /// Its secret, from the answer to `make`.
        secret: u64,
        /// The last answer received by the client.
        received: u64,
    },
    /// Prepares all objects.
    Prepare,
    /// Names of the objects.
    Names,
    /// Ends the session.
    Close,
    /// Cancels running and waiting commands. It is not queued behind them.
    Cancel,
}

/// A command with its number.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Number of the command, repeated in its answer; ascending within a session.
    pub id: u64,
    /// The last answer received by the client: earlier ones need not be kept.
    pub seen: Option<u64>,
    /// Arrays of the answer may be in shared memory.
    pub shm: bool,
    pub command: Command,
}

impl Request {
    /// Reads a frame of a client.
    ///
    /// # Errors
    /// The error of an invalid frame, and its number if it has one.
    pub fn parse(frame: &Value<'_>) -> Result<Self, (Option<u64>, Fault)> {
        let fields = Fields::new(frame).map_err(|fault| (None, fault))?;
        let id = fields.natural("id").map_err(|fault| (None, fault))?;
        let Some(id) = id else {
            return Err((None, Fault::config("id", "the field 'id' is missing; number your commands")));
        };
        Self::with_id(id, &fields).map_err(|fault| (Some(id), fault))
    }

    fn with_id(id: u64, fields: &Fields<'_, '_>) -> Result<Self, Fault> {
        let name = fields.text("command")?;
        let Some((_, own, parse)) = COMMANDS.iter().find(|(known, ..)| *known == name) else {
            let known: Vec<_> = COMMANDS.iter().map(|(name, ..)| *name).collect();
            let name = crate::wire::value::shorten(name);
            let message = format!("there is no command '{name}'; choose from {}", known.join(", "));
            return Err(Fault::config("command", message));
        };
        fields.only(&[&COMMON, *own].concat())?;
        Ok(Self { id, seen: fields.natural("seen")?, shm: fields.flag("shm")?, command: parse(fields)? })
    }
}

fn make(fields: &Fields<'_, '_>) -> Result<Command, Fault> {
    let mut request = serde_json::Map::new();
    for name in ["environment", "num_envs", "vector", "objects", "keywords"] {
        if let Some(value) = fields.get(name) {
            request.insert(name.to_owned(), json(value, name)?);
        }
    }
    if fields.get("keywords").is_some_and(|keywords| !matches!(keywords, Value::Map(_))) {
        return Err(Fault::config("keywords", "the field 'keywords' is of another type; give a map"));
    }
    fields.flag("vector")?;
    let millimetres = match fields.get("depth").map(|_| fields.text("depth")).transpose()? {
        None | Some("float32") => false,
        Some("uint16") => true,
        Some(other) => {
            let message = format!("depth is '{other}'; choose from 'float32' (metres), 'uint16' (millimetres)");
            return Err(Fault::config("depth", message));
        }
    };
    let count = |name, default| Ok(fields.natural(name)?.map_or(default, |n| usize::try_from(n).unwrap_or(usize::MAX)));
    let (num_envs, first) = (count("num_envs", 1)?, count("first_env", 0)?);
    let asked =
        SessionOptions { num_envs, millimetres, first, grace: fields.number("grace")?, shm: fields.flag("share")? };
    Ok(Command::Make { request: request.into(), asked })
}

fn reset(fields: &Fields<'_, '_>) -> Result<Command, Fault> {
    let seeds = match fields.get("seed") {
        None => Seeds::Continue,
        Some(Value::Integer(_)) => Seeds::First(fields.natural("seed")?.unwrap_or_default()),
        Some(many) => {
            let each = items(many, "seed").map_err(|fault| match many {
                Value::List(_) | Value::Array(_) => fault,
                _ => wrong("seed", "an integer that is not negative, or a list of them"),
            })?;
            let one = |value: &Value<'_>| match value {
                Value::Nil => Ok(None),
                value => natural(value, "seed").map(Some),
            };
            Seeds::Each(each.iter().map(one).collect::<Result<_, _>>()?)
        }
    };
    let option = |value: &Value<'_>| match value {
        Value::Nil => Ok(ResetOptions::default()),
        Value::Text(text) => config(text, "reset options").map_err(|error| Fault::config("options", error.to_string())),
        value => config_of(&json(value, "options")?, "reset options")
            .map_err(|error| Fault::config("options", error.to_string())),
    };
    let options = match fields.get("options") {
        None => vec![ResetOptions::default()],
        Some(Value::List(each)) => each.iter().map(option).collect::<Result<_, _>>()?,
        Some(one) => vec![option(one)?],
    };
    Ok(Command::Reset { seeds, mask: fields.flags("mask")?, options })
}
