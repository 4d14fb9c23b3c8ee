//! `mirror.proto`: views on their way to another process.

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::geometry::{aabb_from_wire, aabb_to_wire, required};
use super::v1;
use super::v1::mirror_message::Message;
use crate::config::{LanguageConfig, MapConfig, RadianceConfig};
use crate::error::{Error, Result};
use crate::frame::Contract;
use crate::map::{Copied, Head, Part, Table};
use crate::octree::Root;

/// The format of slots (`src/map/mirror`).
const FORMAT: u32 = 1;

/// What a reader asks for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subscription {
    pub map_id: String,
    pub copied: Copied,
    pub min_interval: Duration,
}

impl Subscription {
    /// All of a map, every epoch.
    pub fn whole(map_id: &str) -> Self {
        Self { map_id: map_id.into(), copied: Copied::ALL, min_interval: Duration::ZERO }
    }
}

impl From<v1::SubscribeRequest> for Subscription {
    fn from(message: v1::SubscribeRequest) -> Self {
        Self {
            map_id: message.map_id,
            copied: Copied { radiance: !message.no_radiance, language: !message.no_language },
            min_interval: Duration::from_millis(message.min_interval_ms.into()),
        }
    }
}

/// The message of what a reader asks for.
pub fn subscription_to_wire(asked: &Subscription) -> v1::SubscribeRequest {
    v1::SubscribeRequest {
        map_id: asked.map_id.clone(),
        no_radiance: !asked.copied.radiance,
        no_language: !asked.copied.language,
        min_interval_ms: u32::try_from(asked.min_interval.as_millis()).unwrap_or(u32::MAX),
    }
}

/// A map's settings on the wire: those that its file holds too.
#[derive(Serialize, Deserialize)]
struct Settings {
    map: MapConfig,
    radiance: RadianceConfig,
    /// Servers from before there was a choice do not say it.
    #[serde(default)]
    color_degree: u8,
    language: LanguageConfig,
}

fn settings_to_wire(config: &MapConfig) -> Result<String> {
    let settings = Settings {
        map: config.clone(),
        radiance: config.radiance,
        color_degree: config.radiance.degree,
        language: config.language.clone(),
    };
    serde_json::to_string(&settings)
        .map_err(|e| Error::Internal(format!("settings did not become JSON: {e}")))
}

fn settings_from_wire(text: &str) -> Result<MapConfig> {
    let Settings { map, radiance, color_degree, language } = serde_json::from_str(text)
        .map_err(|e| Error::invalid("settings_json", format!("cannot be read: {e}")))?;
    let radiance = RadianceConfig { degree: color_degree, ..radiance };
    MapConfig { radiance, language, ..map }.checked()
}

/// The message of a head.
pub fn head_to_wire(head: &Head) -> Result<v1::MirrorMessage> {
    let root = head.root.map(|Root { node, min, log2_size }| v1::MirrorRoot {
        node,
        min: min.to_vec(),
        log2_size: log2_size.into(),
    });
    let contract = head.contract.as_ref();
    let head = v1::MirrorHead {
        from_epoch: head.from_epoch,
        epoch: head.epoch,
        newest_stamp_ns: head.newest_stamp_ns,
        settings_json: match head.from_epoch {
            Some(_) => String::new(),
            None => settings_to_wire(&head.config)?,
        },
        root,
        bounds: head.bounds.as_ref().and_then(aabb_to_wire),
        slots: head.slots.to_vec(),
        encoder_id: contract.map_or(String::new(), |contract| contract.encoder_id.to_string()),
        dimension: contract.map_or(0, |contract| contract.dimension as u32),
        format: FORMAT,
    };
    Ok(v1::MirrorMessage { message: Some(Message::Head(head)) })
}

/// A head, whose settings are those of the view before where it says none.
pub fn head_from_wire(head: v1::MirrorHead, before: Option<&MapConfig>) -> Result<Head> {
    if head.format != FORMAT {
        let problem = format!("{} is not known here; this reader knows {FORMAT}", head.format);
        return Err(Error::invalid("head.format", problem));
    }
    let config = match (head.from_epoch, before) {
        (Some(_), Some(config)) => config.clone(),
        _ => settings_from_wire(&head.settings_json)?,
    };
    let root = |root: v1::MirrorRoot| {
        let problem = || Error::invalid("head.root", "is not x y z and a size");
        Ok(Root {
            node: root.node,
            min: root.min.try_into().map_err(|_| problem())?,
            log2_size: u8::try_from(root.log2_size).map_err(|_| problem())?,
        })
    };
    let contract =
        Contract { encoder_id: head.encoder_id.into(), dimension: head.dimension as usize };
    Ok(Head {
        from_epoch: head.from_epoch,
        epoch: head.epoch,
        newest_stamp_ns: head.newest_stamp_ns,
        config: Arc::new(config),
        root: head.root.map(root).transpose()?,
        bounds: head.bounds.map(|bounds| aabb_from_wire(Some(bounds))),
        slots: head.slots.try_into().map_err(|slots: Vec<u32>| {
            let problem = format!("are {} sizes; {} are known here", slots.len(), Table::ALL.len());
            Error::invalid("head.slots", problem)
        })?,
        contract: (contract.dimension > 0).then_some(contract),
    })
}

/// The message of a part.
pub fn part_to_wire(part: Part) -> v1::MirrorMessage {
    let table = match part.table {
        Table::Nodes => v1::MirrorTable::Nodes,
        Table::Rows => v1::MirrorTable::Rows,
        Table::Bricks => v1::MirrorTable::Bricks,
        Table::Colors => v1::MirrorTable::Colors,
        Table::Codes => v1::MirrorTable::Codes,
        Table::Atoms => v1::MirrorTable::Atoms,
        Table::Decoders => v1::MirrorTable::Decoders,
        Table::Viewpoints => v1::MirrorTable::Viewpoints,
    };
    let part = v1::MirrorPart { table: table.into(), slots: part.slots, data: part.bytes };
    v1::MirrorMessage { message: Some(Message::Part(part)) }
}

impl TryFrom<v1::MirrorPart> for Part {
    type Error = Error;

    fn try_from(part: v1::MirrorPart) -> Result<Self> {
        // The wire's numbers begin with 1.
        let at = usize::try_from(part.table).ok().and_then(|table| table.checked_sub(1));
        let table = required("part.table", at.and_then(|at| Table::ALL.get(at)).copied())?;
        Ok(Self { table, slots: part.slots, bytes: part.data })
    }
}

/// The message of an update's end.
pub fn end_to_wire(epoch: u64) -> v1::MirrorMessage {
    v1::MirrorMessage { message: Some(Message::End(v1::MirrorEnd { epoch })) }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use prost::Message as _;

    use super::*;
    use crate::config::MapSettings;
    use crate::geometry::Aabb;

    fn settings() -> MapSettings {
        MapSettings { color_degree: 2, ..MapSettings::default() }
    }

    fn head(from_epoch: Option<u64>) -> Head {
        Head {
            from_epoch,
            epoch: 9,
            newest_stamp_ns: -3,
            config: Arc::new(MapConfig::from_settings(&settings()).expect("settings")),
            root: Some(Root { node: 4, min: [-8, 0, 16], log2_size: 7 }),
            bounds: Some(Aabb { min: Vec3::splat(-0.1), max: Vec3::new(0.3, 4.0, 1e-3) }),
            slots: [1, 2, 3, 4, 5, 6, 7, 8],
            contract: Some(Contract { encoder_id: "clip".into(), dimension: 512 }),
        }
    }

    fn received(message: &v1::MirrorMessage) -> Message {
        let bytes = message.encode_to_vec();
        v1::MirrorMessage::decode(&bytes[..]).expect("our own").message.expect("one of three")
    }

    #[test]
    fn heads_and_parts_come_back_as_they_were() {
        let first = head(None);
        for (head, before) in [(first.clone(), None), (head(Some(8)), Some(&*first.config))] {
            let Message::Head(message) = received(&head_to_wire(&head).expect("a message")) else {
                panic!("a head");
            };
            assert_eq!(head_from_wire(message, before).expect("our own"), head);
        }
        for table in Table::ALL {
            let part = Part { table, slots: vec![3, 1], bytes: vec![1, 2, 3, 4] };
            let Message::Part(message) = received(&part_to_wire(part.clone())) else {
                panic!("a part");
            };
            assert_eq!(Part::try_from(message).expect("our own"), part);
        }
        let asked = Subscription {
            map_id: "default".into(),
            copied: Copied { radiance: false, language: true },
            min_interval: Duration::from_millis(7),
        };
        assert_eq!(Subscription::from(subscription_to_wire(&asked)), asked);
    }

    #[test]
    fn what_is_wrong_with_a_message_is_named() {
        let Some(Message::Head(good)) = head_to_wire(&head(None)).expect("a message").message
        else {
            panic!("a head");
        };
        type Spoil = fn(&mut v1::MirrorHead);
        let cases: [(&str, Spoil); 5] = [
            ("head.format", |head| head.format = 2),
            ("settings_json", |head| head.settings_json = "{}".into()),
            ("head.root", |head| head.root.as_mut().expect("one").min.clear()),
            ("head.root", |head| head.root.as_mut().expect("one").log2_size = 256),
            ("head.slots", |head| head.slots.truncate(7)),
        ];
        for (field, spoil) in cases {
            let mut message = good.clone();
            spoil(&mut message);
            assert_eq!(head_from_wire(message, None).expect_err(field).field(), Some(field));
        }
        // Settings are checked as those of a file are.
        let wild = v1::MirrorHead {
            settings_json: good.settings_json.replace("\"r0_m\":0.1", "\"r0_m\":-0.1"),
            ..good
        };
        assert!(wild.settings_json.contains("-0.1"), "{}", wild.settings_json);
        head_from_wire(wild, None).expect_err("no size");
        let part = v1::MirrorPart { table: 9, ..v1::MirrorPart::default() };
        assert_eq!(Part::try_from(part).expect_err("no table").field(), Some("part.table"));
    }
}
