//! A configuration in files: what is read goes through the same checks as what is typed.

use super::PaperConfig;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

// `remote = "Self"` on the type makes these calls the derived functions.
impl Serialize for PaperConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        PaperConfig::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for PaperConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        PaperConfig::deserialize(deserializer)?.check().map_err(Error::custom)
    }
}
