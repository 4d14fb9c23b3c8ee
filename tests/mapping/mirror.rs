//! A copy of a view, told in parts, answers as the original does, bit for bit.

use std::ops::ControlFlow;
use std::sync::Arc;

use glam::Vec3;
use orenx::config::{CodeForm, MapConfig, MapSettings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::dataset::synthetic::moved_box::BEFORE;
use orenx::error::Result;
use orenx::frame::Frame;
use orenx::geometry::{Aabb, Region, Solid};
use orenx::map::{
    Clear, Copied, Copying, Edit, Fields, Head, MapView, Mapper, Part, STAMP_ROBOT, Stamp, Table,
};
use orenx::surface::Stamping;

use super::language::{direction, frame};

/// Small, so that every table comes in several parts.
const PART_BYTES: usize = 10_000;

fn config(codes: CodeForm) -> MapConfig {
    let settings = MapSettings {
        modalities: ["sdf", "occupancy", "radiance", "language"].map(String::from).to_vec(),
        steps: Some(1),
        color_degree: 2,
        codes,
        ..MapSettings::default()
    };
    MapConfig::from_settings(&settings).unwrap()
}

fn colored(data: &Synthetic, index: usize) -> Frame {
    Frame { color: data.load(index, true).unwrap().color, ..frame(data, index, BEFORE) }
}

/// What is told of the way from one view to another.
fn told(new: &MapView, old: Option<&MapView>, copied: Copied) -> (Head, Vec<Part>) {
    let (changes, mut parts) = (new.changes(old, copied), Vec::new());
    let all = changes.parts(PART_BYTES, &mut |part| {
        parts.push(part);
        ControlFlow::Continue(())
    });
    assert!(all.is_continue());
    (changes.head(), parts)
}

fn copy((head, parts): (Head, Vec<Part>), old: Option<&MapView>) -> Result<MapView> {
    let mut copying = Copying::start(head, old)?;
    parts.iter().try_for_each(|part| copying.take(part))?;
    copying.finish()
}

fn assert_same(copy: &MapView, view: &MapView) {
    let (a, b) = (copy.state(), view.state());
    assert_eq!(format!("{:?}", a.record), format!("{:?}", b.record));
    assert!(a.children == b.children && a.corners == b.corners, "nodes");
    assert!(a.low_corners == b.low_corners && a.log2_sizes == b.log2_sizes, "nodes");
    assert!(a.node_bricks == b.node_bricks && a.known == b.known, "evidence");
    let bytes = |rows| -> Vec<u8> { bytemuck::cast_slice(rows).to_vec() };
    assert!(bytes(&a.rows[..]) == bytes(&b.rows[..]), "rows");
    assert!(a.color_cells == b.color_cells && a.texels == b.texels, "colours");
    assert!(a.harmonics == b.harmonics && !b.harmonics.is_empty(), "harmonics");
    assert_eq!(a.codes.learned, b.codes.learned);
    assert!(a.codes.cells == b.codes.cells && a.codes.codes == b.codes.codes, "codes");
    assert!(!b.viewpoints.is_empty() && a.viewpoints == b.viewpoints, "cameras");

    let bounds = view.bounds();
    let at = |i: usize| {
        let part = |step: usize| (i * step % 97) as f32 / 97.0;
        bounds.min + bounds.size() * Vec3::new(part(13), part(31), part(57))
    };
    let points: Vec<Vec3> = (0..5000).map(at).collect();
    let answers = |view: &MapView| {
        let text = view.scorer(&[direction(1)], &[direction(0)]).unwrap();
        let fields = Fields { text_score: true, ..Fields::ALL };
        let a = view.query_with(&points, fields, Some(&text));
        let numbers: [&[f32]; 5] = [
            &a.distance,
            &a.occupancy,
            &a.text_score,
            bytemuck::cast_slice(&a.gradient),
            bytemuck::cast_slice(&a.color),
        ];
        assert!(numbers.iter().all(|column| column.iter().any(|x| x.is_finite())));
        numbers.concat().iter().map(|x| x.to_bits()).collect::<Vec<u32>>()
    };
    assert!(answers(copy) == answers(view), "answers");
}

#[test]
fn a_copy_that_follows_is_the_view_bit_for_bit() {
    let data = Synthetic::removed_box(20, 20).with_width(120);
    for codes in [CodeForm::F16, CodeForm::F32, CodeForm::TopK] {
        let mut mapper = Mapper::new(config(codes)).unwrap();
        let (mut followed, mut last) = (None::<(MapView, Arc<MapView>)>, 0);
        for index in 0..6 {
            mapper.integrate(&colored(&data, index)).unwrap();
            // What is forgotten is told too, and what is put in.
            let ball = (BEFORE, 0.4);
            let edit = match index {
                3 => Some(Edit::Clear(Clear {
                    region: Some(Region::Sphere { center: ball.0, radius_m: ball.1 }),
                    ..Clear::default()
                })),
                4 => Some(Edit::Stamp(Stamp {
                    solid: Solid::Sphere { center: ball.0, radius_m: 0.5 * ball.1 },
                    stamping: Stamping::Add,
                    color: Some(Vec3::new(0.1, 0.9, 0.2)),
                    robot_id: STAMP_ROBOT.into(),
                })),
                _ => None,
            };
            if let Some(edit) = edit {
                let edited = mapper.edit(&edit).unwrap();
                assert!(edited.surfels_removed + edited.surfels_added > 20, "{edited:?}");
            }
            let view = mapper.publish();
            let old = followed.as_ref().map(|(copy, original)| (copy, &**original));
            let (head, parts) = told(&view, old.map(|(_, original)| original), Copied::ALL);
            assert!(parts.iter().all(|part| part.bytes.len() < PART_BYTES + 40_000));
            last = parts.iter().map(|part| part.bytes.len()).sum();
            let next = copy((head, parts), old.map(|(copy, _)| copy)).unwrap();
            assert_same(&next, &view);
            followed = Some((next, view));
        }
        let (_, view) = followed.unwrap();
        let (head, parts) = told(&view, None, Copied::ALL);
        let whole: usize = parts.iter().map(|part| part.bytes.len()).sum();
        assert!(last < whole, "{last} of {whole} bytes for one frame");
        assert_same(&copy((head, parts), None).unwrap(), &view);
        assert!(told(&view, Some(&view), Copied::ALL).1.is_empty(), "nothing changed");
    }
}

#[test]
fn what_is_left_out_is_not_told_and_not_there() {
    let data = Synthetic::removed_box(20, 20).with_width(120);
    let mut mapper = Mapper::new(config(CodeForm::F16)).unwrap();
    mapper.integrate(&colored(&data, 0)).unwrap();
    let view = mapper.publish();
    let copied = Copied { radiance: false, language: false };
    let (head, parts) = told(&view, None, copied);
    let left_out = [Table::Colors, Table::Codes, Table::Atoms];
    assert!(parts.iter().all(|part| !left_out.contains(&part.table)));
    let lean = copy((head, parts), None).unwrap();
    let points = [Vec3::ZERO, BEFORE, BEFORE + 0.5];
    let (a, b) = (lean.query(&points, Fields::ALL), view.query(&points, Fields::ALL));
    assert!(a.color.is_empty() && !b.color.is_empty() && lean.contract().is_none());
    let bits = |numbers: &[f32]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<u32>>();
    assert_eq!((a.state, bits(&a.distance)), (b.state, bits(&b.distance)));
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let data = Synthetic::removed_box(20, 20).with_width(120);
    let mut mapper = Mapper::new(config(CodeForm::F16)).unwrap();
    mapper.integrate(&colored(&data, 0)).unwrap();
    let first = mapper.publish();
    mapper.integrate(&colored(&data, 1)).unwrap();
    let second = mapper.publish();
    let whole = || told(&first, None, Copied::ALL);

    // A change of another view than the one that is here.
    let (head, parts) = told(&second, Some(&first), Copied::ALL);
    for old in [None, Some(&*second)] {
        let refused = copy((head.clone(), parts.clone()), old).err().unwrap().to_string();
        assert!(refused.contains(&format!("from epoch {}", first.epoch())), "{refused}");
    }
    // A map that begins anew goes on from nothing.
    let other = Mapper::new(config(CodeForm::F16)).unwrap().publish();
    assert_eq!(other.changes(Some(&first), Copied::ALL).head().from_epoch, None);

    type Spoil = fn(&mut Head, &mut Vec<Part>);
    let cases: [(&str, Spoil); 14] = [
        ("whole slots", |_, parts| parts[0].bytes.truncate(17)),
        ("whole slots", |_, parts| parts[0].slots.clear()),
        ("whole slots", |_, parts| parts[0].bytes.clear()),
        ("is not there", |_, parts| parts[0].slots[0] = u32::MAX),
        ("not there", |_, parts| parts[0].bytes[4..8].copy_from_slice(&[0xff, 0xff, 0xff, 0x7f])),
        ("wrong length", |_, parts| {
            let length = parts[0].bytes.len() / 2;
            parts[0].bytes.truncate(length);
        }),
        ("wrong length", |_, parts| {
            let part = parts.iter_mut().find(|part| part.table == Table::Colors).unwrap();
            // The last block loses its last vertex.
            let block = part.bytes.len() / part.slots.len();
            part.slots.truncate(1);
            part.bytes.truncate(block - 6 * 9);
        }),
        ("not told", |_, parts| parts.retain(|part| part.table != Table::Colors)),
        ("not told", |_, parts| parts.retain(|part| part.table != Table::Codes)),
        ("without their encoder", |head, _| head.contract = None),
        ("more slots", |head, _| head.slots[0] = u32::MAX),
        ("more slots", |head, _| head.slots[7] = 1 << 27),
        ("bounds", |head, _| head.bounds = Some(Aabb { min: Vec3::NAN, max: Vec3::ZERO })),
        ("not there", |_, parts| parts[0].bytes[4..8].fill(0)),
    ];
    for (words, spoil) in cases {
        let (mut head, mut parts) = whole();
        spoil(&mut head, &mut parts);
        let refused = copy((head, parts), None).err().expect(words).to_string();
        assert!(refused.contains(words), "{words}: {refused}");
    }
}
