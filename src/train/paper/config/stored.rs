//! Serialization of a configuration. Files are validated like command-line options.

use super::PaperConfig;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

// With `remote = "Self"` on the type, these calls resolve to the derived inherent functions.
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
