//! What a server tells those who follow a map: heads, parts and ends, out of which a view is put
//! together. The input holds them one after another, as a message with a repeated field.

use std::ops::ControlFlow;
use std::sync::Arc;

use orenx::error::{Error, Result};
use orenx::map::{Copied, Copying, MapView, Part};
use orenx::wire::v1::mirror_message::Message as Told;
use orenx::wire::{end_to_wire, head_from_wire, head_to_wire, part_to_wire, read_message, v1};
use prost::Message;

use super::{Layout, Target, maps, scene};

pub(super) const TARGET: Target =
    Target { name: "mirror", read, seeds, layout: Layout::Protobuf(0), longest: 1 << 17 };

/// Of the parts of seeds, bytes.
const PART_BYTES: usize = 4096;

#[derive(Clone, PartialEq, Message)]
struct Stream {
    #[prost(message, repeated, tag = "1")]
    messages: Vec<v1::MirrorMessage>,
}

fn read(input: &[u8]) -> bool {
    follow(input).is_ok()
}

/// As `client::Mirror` does.
fn follow(input: &[u8]) -> Result<()> {
    let mut copying: Option<Copying> = None;
    let mut told: Option<Arc<MapView>> = None;
    for message in read_message::<Stream>(input)?.messages {
        match (message.message, &mut copying) {
            (Some(Told::Head(head)), None) => {
                let head = head_from_wire(head, told.as_ref().map(|view| view.config()))?;
                copying = Some(Copying::start(head, told.as_deref())?);
            }
            (Some(Told::Part(part)), Some(copying)) => copying.take(&Part::try_from(part)?)?,
            (Some(Told::End(_)), Some(_)) => {
                if let Some(copying) = copying.take() {
                    let view = Arc::new(copying.finish()?);
                    maps::look(&view);
                    told = Some(view);
                }
            }
            _ => return Err(Error::corrupt("mirror", "messages came in a wrong order")),
        }
    }
    Ok(())
}

fn seeds() -> Vec<Vec<u8>> {
    let settings = orenx::config::MapSettings { color_degree: 1, ..scene::settings() };
    let mut mapper = scene::map(&settings, &[scene::frame(10)]);
    let first = mapper.publish_all().unwrap();
    mapper.integrate(&scene::frame(60)).unwrap();
    let second = mapper.publish_all().unwrap();
    let mut messages = update(&first, None);
    let whole = Stream { messages: messages.clone() }.encode_to_vec();
    messages.extend(update(&second, Some(&first)));
    vec![whole, Stream { messages }.encode_to_vec()]
}

/// The messages that make a view of another.
fn update(view: &MapView, old: Option<&MapView>) -> Vec<v1::MirrorMessage> {
    let changes = view.changes(old, Copied::ALL);
    let mut messages = vec![head_to_wire(&changes.head()).unwrap()];
    let told = changes.parts(PART_BYTES, &mut |part| {
        messages.push(part_to_wire(part));
        ControlFlow::Continue(())
    });
    assert!(told.is_continue());
    messages.push(end_to_wire(view.epoch()));
    messages
}
