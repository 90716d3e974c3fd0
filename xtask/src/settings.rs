//! `--set KEY=VALUE`: the dials of methods, each with its default, its range and what it trades.

use std::collections::BTreeMap;
use std::fmt;

use crate::failure::Failure;

/// One dial.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Key {
    /// As written before the `=`.
    pub(crate) name: &'static str,
    /// As written after it.
    pub(crate) default: &'static str,
    /// What may be written there.
    pub(crate) range: Range,
    /// What one gets for turning it, and pays.
    pub(crate) trades: &'static str,
}

/// Values that a key takes.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Range {
    /// A whole number, both ends included.
    Whole(u64, u64),
    /// A number, both ends included; an infinite end admits `inf`.
    Number(f32, f32),
    /// One of these words.
    OneOf(&'static [&'static str]),
    /// One of these words or a number, both ends included.
    WordOrNumber(&'static str, f32, f32),
    /// Words where one may be followed by `:NUMBER`; read by whoever owns the key.
    Words(&'static str),
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Whole(min, max) => write!(f, "a whole number from {min} to {max}"),
            Self::Number(min, max) => write!(f, "a number from {min} to {max}"),
            Self::OneOf(words) => write!(f, "{}", words.join(" or ")),
            Self::WordOrNumber(word, min, max) => write!(f, "{word} or a number from {min} to {max}"),
            Self::Words(words) => write!(f, "{words}"),
        }
    }
}

impl Range {
    fn admits(self, value: &str) -> bool {
        let number_in = |min: f32, max: f32| value.parse().is_ok_and(|x: f32| (min..=max).contains(&x));
        match self {
            Self::Whole(min, max) => value.parse().is_ok_and(|x: u64| (min..=max).contains(&x)),
            Self::Number(min, max) => number_in(min, max),
            Self::OneOf(words) => words.contains(&value),
            Self::WordOrNumber(word, min, max) => value == word || number_in(min, max),
            Self::Words(_) => !value.is_empty(),
        }
    }
}

/// Keys and values of one run: every key of the method is there, and in its range.
#[derive(Clone, Debug)]
pub(crate) struct Settings(BTreeMap<&'static str, String>);

impl Settings {
    /// Defaults of `keys`, overwritten by `assignments` (`KEY=VALUE` each). `owner` has the keys, for
    /// messages.
    ///
    /// # Errors
    /// A usage error for what is not `KEY=VALUE`, for a key that `owner` does not have, and for a value out
    /// of range.
    pub(crate) fn parse(owner: &str, keys: &[Key], assignments: &[String]) -> Result<Self, Failure> {
        let mut values: BTreeMap<_, _> = keys.iter().map(|key| (key.name, key.default.to_owned())).collect();
        for assignment in assignments {
            let (name, value) = split(assignment)?;
            let Some(key) = keys.iter().find(|key| key.name == name) else {
                let names: Vec<_> = keys.iter().map(|key| key.name).collect();
                let meant = scene::nearest(name, names.iter().copied());
                let meant = meant.map_or_else(String::new, |meant| format!("; did you mean `{meant}`?"));
                return Err(Failure::usage(format!(
                    "--set {assignment}: {owner} has no key `{name}`{meant}: its keys are {}",
                    names.join(", ")
                )));
            };
            if !key.range.admits(value) {
                return Err(Failure::usage(format!("--set {assignment}: `{name}` is {}", key.range)));
            }
            values.insert(key.name, value.to_owned());
        }
        Ok(Self(values))
    }

    /// All keys with their values, for scripts.
    pub(crate) fn json(&self) -> serde_json::Value {
        self.0.iter().map(|(&key, value)| (key.to_owned(), serde_json::Value::from(value.as_str()))).collect()
    }

    /// The value of a key as text, if the method has that key.
    pub(crate) fn find(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }

    /// The value of a key as text.
    ///
    /// # Panics
    /// If these settings were made without the key.
    pub(crate) fn text(&self, key: &str) -> &str {
        self.find(key).unwrap_or_else(|| panic!("the method's table lacks the key `{key}`"))
    }

    /// The value of a [`Range::Whole`] key.
    ///
    /// # Panics
    /// If these settings were made without the key, or it is no whole number.
    pub(crate) fn whole(&self, key: &str) -> u32 {
        self.text(key).parse().unwrap_or_else(|_| panic!("the key `{key}` is not in u32's range"))
    }

    /// The value of a number, if it is one and not the word of a [`Range::WordOrNumber`].
    pub(crate) fn number(&self, key: &str) -> Option<f32> {
        self.text(key).parse().ok()
    }

    /// [`number`](Self::number) of a key that not every method has.
    pub(crate) fn find_number(&self, key: &str) -> Option<f32> {
        self.find(key)?.parse().ok()
    }
}

/// Both sides of `KEY=VALUE`.
///
/// # Errors
/// A usage error where there is no `=`.
pub(crate) fn split(assignment: &str) -> Result<(&str, &str), Failure> {
    let parts = assignment.split_once('=').map(|(name, value)| (name.trim(), value.trim()));
    parts.ok_or_else(|| Failure::usage(format!("--set {assignment}: write it as KEY=VALUE")))
}

#[cfg(test)]
mod tests {
    use super::{Key, Range, Settings};

    const KEYS: [Key; 3] = [
        Key { name: "lights", default: "1", range: Range::Whole(1, 64), trades: "" },
        Key { name: "clamp", default: "inf", range: Range::Number(0.0, f32::INFINITY), trades: "" },
        Key {
            name: "exposure",
            default: "auto",
            range: Range::WordOrNumber("auto", -20.0, 20.0),
            trades: "",
        },
    ];

    fn parse(assignments: &[&str]) -> Result<Settings, String> {
        let assignments: Vec<_> = assignments.iter().map(|&a| a.to_owned()).collect();
        Settings::parse("method `x`", &KEYS, &assignments).map_err(|failure| failure.to_string())
    }

    #[test]
    fn defaults_hold_until_overwritten() {
        let settings = parse(&["lights=4", "lights=8"]).unwrap();
        assert_eq!((settings.whole("lights"), settings.number("clamp")), (8, Some(f32::INFINITY)));
        assert_eq!((settings.number("exposure"), settings.text("exposure")), (None, "auto"));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_mend() {
        assert!(parse(&["threads=4"]).unwrap_err().contains("its keys are lights, clamp, exposure"));
        assert!(parse(&["ligths=4"]).unwrap_err().contains("did you mean `lights`?"));
        assert!(parse(&["lights=0"]).unwrap_err().contains("a whole number from 1 to 64"));
        assert!(
            parse(&["lights=1.5"]).is_err()
                && parse(&["clamp=nan"]).is_err()
                && parse(&["clamp=-1"]).is_err()
        );
        assert!(parse(&["lights"]).unwrap_err().contains("KEY=VALUE"));
    }
}
