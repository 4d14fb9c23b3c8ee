//! What frames say of meaning, and what is where, in words.

use glam::Vec3;
use orenx::client::HttpClient;
use orenx::config::{EncoderKind, EncoderSettings, Settings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::encoder::TextEncoder;
use orenx::engine::Reason;
use orenx::error::Status;
use orenx::geometry::Aabb;
use orenx::map::{Encoding, Fields, Match, Output};
use orenx::service::{
    ClassifyQuestion, DEFAULT_MAP, FindQuestion, ImageKind, ImageQuestion, PointsQuestion, Sought,
};
use orenx::wire::v1;
use orenx::wire::v1::frame::Meaning;
use orenx::wire::v1::{FrameReason, FrameStatus};

use super::images::camera;
use super::{Running, good_frame, open_stream, start, verdict};
use crate::support::encoder::words;

/// Settings of a server with the encoder in `folder`.
pub(crate) fn with_encoder(settings: &mut Settings, folder: &std::path::Path) {
    let kind = EncoderKind::Static;
    settings.encoder = EncoderSettings { kind, folder: folder.into(), ..settings.encoder.clone() };
}

/// The left half of an image is a chair, the right half a table.
fn labels(frame: &v1::Frame) -> v1::LabelImage {
    let k = frame.intrinsics.as_ref().unwrap();
    let row = (0..k.width).map(|u| if u < k.width / 2 { 3 } else { 7 });
    let class = |id, name: &str| v1::LabelClass { id, name: name.into() };
    v1::LabelImage {
        encoding: v1::LabelEncoding::U8.into(),
        data: (0..k.height).flat_map(|_| row.clone()).collect(),
        classes: vec![class(7, "table"), class(3, "chair")],
        ..Default::default()
    }
}

/// A frame with such labels.
pub(crate) fn labelled_frame(seq: u64) -> v1::Frame {
    let mut frame = good_frame(seq);
    frame.meaning = Some(Meaning::Labels(labels(&frame)));
    frame
}

/// A frame with a grid of 4 × 3 features of an encoder.
fn featured_frame(seq: u64, encoder_id: &str, dimension: u32) -> v1::Frame {
    let numbers = (0..12 * dimension).map(|i| (i % 5) as f32 - 1.0);
    let features = v1::FeatureImage {
        encoder_id: encoder_id.into(),
        width: 4,
        height: 3,
        dimension,
        encoding: v1::FeatureEncoding::F32.into(),
        data: numbers.flat_map(f32::to_le_bytes).collect(),
        index: Vec::new(),
    };
    v1::Frame { meaning: Some(Meaning::Features(features)), ..good_frame(seq) }
}

/// The verdicts of frames, one after another.
pub(crate) async fn verdicts(server: &Running, frames: Vec<v1::Frame>) -> Vec<v1::FrameAck> {
    let (sender, mut acks) = open_stream(&server.channel).await;
    let mut verdicts = Vec::new();
    for frame in frames {
        sender.send(frame).await.unwrap();
        verdicts.push(verdict(&mut acks).await);
    }
    verdicts
}

/// A refusal for its encoder, and the words of it.
fn assert_refused(ack: &v1::FrameAck, field: &str, words: &[&str]) {
    let reason = (ack.status(), ack.reason());
    assert_eq!(reason, (FrameStatus::Rejected, FrameReason::Encoder), "{ack:?}");
    assert_eq!(ack.field, field, "{ack:?}");
    for word in words {
        assert!(ack.message.contains(word), "{word} in {}", ack.message);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn labels_need_an_encoder_on_the_server() {
    let server = start(|_| {}).await;
    let acks = verdicts(&server, vec![labelled_frame(1), good_frame(2)]).await;
    assert_refused(&acks[0], "labels", &["text encoder", "encoder.kind"]);
    assert_eq!(acks[1].status(), FrameStatus::Integrated);
    let counts = server.client.map_stats(DEFAULT_MAP).await.unwrap().counts;
    assert_eq!(counts.rejected, [(Reason::Encoder, 1)]);
    server.stop().await.0.unwrap();

    let external = |settings: &mut Settings| {
        settings.encoder.kind = EncoderKind::External;
        (settings.encoder.id, settings.encoder.dimension) = ("clip".into(), 512);
    };
    let server = start(external).await;
    let acks = verdicts(&server, vec![labelled_frame(1), featured_frame(2, "clip", 512)]).await;
    assert_refused(&acks[0], "labels", &["'clip' embeds no text", "512"]);
    assert_eq!(acks[1].status(), FrameStatus::Integrated);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn labels_and_features_of_the_servers_encoder_are_taken_and_others_refused() {
    let folder = words();
    let encoder = TextEncoder::open_static(folder.path()).unwrap();
    let id = encoder.contract().encoder_id.to_string();
    let server = start(|settings| with_encoder(settings, folder.path())).await;
    let mut unknown_word = labelled_frame(4);
    let Some(Meaning::Labels(labels)) = &mut unknown_word.meaning else { panic!("labels") };
    labels.classes[0].name = "nothing".into();
    let frames = vec![
        labelled_frame(1),
        featured_frame(2, &id, 8),
        featured_frame(3, "clip", 8),
        unknown_word,
        featured_frame(5, &id, 7),
    ];
    let acks = verdicts(&server, frames).await;
    assert_eq!(acks[0].status(), FrameStatus::Integrated, "{:?}", acks[0]);
    assert_eq!(acks[1].status(), FrameStatus::Integrated, "{:?}", acks[1]);
    assert_refused(&acks[2], "features.encoder_id", &["'clip'", &id]);
    assert_eq!(acks[3].reason(), FrameReason::InvalidField);
    assert_eq!(acks[3].field, "labels.classes[1].name", "in the order of ids");
    assert_refused(&acks[4], "features.encoder_id", &["7 numbers", "8 of"]);
    server.stop().await.0.unwrap();
}

/// A server that saw a room of chair on the left and table on the right of each image.
pub(crate) async fn mapped(folder: &std::path::Path) -> Running {
    let server = start(|settings| with_encoder(settings, folder)).await;
    let frames = [0, 25, 50, 75].map(labelled_frame).to_vec();
    for ack in verdicts(&server, frames).await {
        assert_eq!(ack.status(), FrameStatus::Integrated, "{ack:?}");
    }
    server
}

/// Points of the surfaces that a frame of the room saw, the left ones first.
pub(crate) fn seen_points() -> Vec<Vec3> {
    let room = Synthetic::room(100).with_width(64);
    let frame = room.load(25, false).unwrap();
    let half = frame.depth.width / 2;
    let places = (0..frame.depth.height).flat_map(|v| (0..half).map(move |u| (u, v)));
    let left: Vec<_> = places.step_by(3).collect();
    let right = left.iter().map(|(u, v)| (u + half, *v));
    let all = left.iter().copied().chain(right).filter(|(u, v)| frame.depth.at(*u, *v) > 0.0);
    all.map(|(u, v)| frame.world_point(u, v, frame.depth.at(u, v))).collect()
}

fn embedded(folder: &std::path::Path, words: &[&str]) -> (String, Vec<Vec<f32>>) {
    let encoder = TextEncoder::open_static(folder).unwrap();
    (encoder.contract().encoder_id.to_string(), encoder.embed(words).unwrap())
}

/// Words, their embeddings, and both transports say the same.
#[tokio::test(flavor = "multi_thread")]
async fn things_are_found_in_words_and_in_numbers_over_both_transports() {
    let folder = words();
    let server = mapped(folder.path()).await;
    let http = HttpClient::new(&format!("http://{}", server.http)).unwrap();
    let asked = FindQuestion { top_k: 3, ..FindQuestion::new(Sought::words(&["seat"])) };
    let found = server.client.find(&asked).await.unwrap();
    assert!(!found.findings.matches.is_empty() && found.findings.matches.len() <= 3);
    let (id, prompts) = embedded(folder.path(), &["seat"]);
    assert_eq!((found.encoder_id.as_str(), found.epoch), (id.as_str(), 4));
    assert!(found.findings.matches.iter().all(|m| m.score >= 0.5 && m.voxels >= 4), "{found:?}");
    assert!(found.findings.matches.is_sorted_by(|a, b| a.score >= b.score));
    let best = &found.findings.matches[0];
    assert!(best.best_view.is_some() && best.score > 0.9, "{best:?}");

    let (_, negatives) = embedded(folder.path(), &["object", "things", "stuff", "texture"]);
    let sought = Sought::Embeddings { encoder_id: id, prompts, negatives };
    let in_numbers = FindQuestion { sought, ..asked.clone() };
    for reply in [
        server.client.find(&in_numbers).await.unwrap(),
        http.find(&asked).await.unwrap(),
        http.find(&in_numbers).await.unwrap(),
    ] {
        assert_eq!(reply.epoch, found.epoch);
        assert_eq!(reply.findings.matches.len(), found.findings.matches.len());
        for (one, other) in reply.findings.matches.iter().zip(&found.findings.matches) {
            assert_eq!(Match { best_view: other.best_view, ..one.clone() }, *other);
            // JSON rounds numbers of double precision in their last digit.
            let (one, other) = (one.best_view.unwrap(), other.best_view.unwrap());
            assert!((one.rotation - other.rotation).length() < 1e-12);
            assert!((one.translation - other.translation).length() < 1e-12);
        }
    }

    let region = Some(Aabb { min: best.centroid - 0.3, max: best.centroid + 0.3 });
    let near = server.client.find(&FindQuestion { region, ..asked.clone() }).await.unwrap();
    assert!(near.findings.matches.iter().all(|m| m.extent.max_element() <= 0.8), "{near:?}");
    let nowhere = FindQuestion { min_score: Some(1.0), ..asked };
    assert!(server.client.find(&nowhere).await.unwrap().findings.matches.is_empty());
    let everywhere = FindQuestion { min_score: Some(-1.0), places: true, ..nowhere };
    let whole = server.client.find(&everywhere).await.unwrap().findings.places;
    assert_eq!(http.find(&everywhere).await.unwrap().findings.places, whole);
    let text = Some(everywhere.sought.clone());
    let at = PointsQuestion { text, ..PointsQuestion::new(whole.points.clone()) };
    let there = server.client.ask(&at).await.unwrap().answers.text_score;
    assert!(whole.points.len() > 100, "{}", whole.points.len());
    for (score, there) in whole.scores.iter().zip(there) {
        assert!(there.is_nan() || (score - there).abs() < 1e-5, "{score} and {there}");
    }
    let fitting = FindQuestion { min_score: Some(0.5), ..everywhere };
    let fitting = server.client.find(&fitting).await.unwrap().findings.places.scores;
    assert!(fitting.iter().eq(whole.scores.iter().filter(|s| **s >= 0.5)) && fitting.len() > 9);
    server.stop().await.0.unwrap();
}

/// What one frame saw is scored and classified, as the view says, over both transports.
#[tokio::test(flavor = "multi_thread")]
async fn points_have_scores_and_classes() {
    let folder = words();
    let server = mapped(folder.path()).await;
    let http = HttpClient::new(&format!("http://{}", server.http)).unwrap();
    let points = seen_points();
    let text = Some(Sought::words(&["seat"]));
    let fields = Fields { text_score: true, state: true, ..Fields::DISTANCE };
    let asked = PointsQuestion { fields, text, ..PointsQuestion::new(points.clone()) };
    let reply = server.client.ask(&asked).await.unwrap();
    let bits = |scores: &[f32]| scores.iter().map(|s| s.to_bits()).collect::<Vec<_>>();
    let scores = &reply.answers.text_score;
    let known = scores.iter().filter(|s| !s.is_nan()).count();
    // Small images leave much of the room without a code.
    assert!(known * 10 > points.len() * 4, "{known} of {}", points.len());
    assert!(scores.iter().all(|s| s.is_nan() || (0.0..=1.0).contains(s)));
    let over_http = http.ask(&asked).await.unwrap();
    assert_eq!(bits(&over_http.answers.text_score), bits(scores));
    // A large question is answered in chunks.
    let many = PointsQuestion { points: points.repeat(20), ..asked.clone() };
    let many = server.client.ask(&many).await.unwrap().answers.text_score;
    assert_eq!(bits(&many), bits(scores).repeat(20));

    let names = ["table", "wall", "chair"].map(str::to_owned).to_vec();
    let classes = Sought::Words { prompts: names, negatives: None };
    let asked = ClassifyQuestion::new(points.clone(), classes);
    let classified = server.client.classify(&asked).await.unwrap();
    let (chairs, tables) = classified.class.split_at(points.len() / 2);
    let share = |all: &[i32], class: i32| {
        let known = all.iter().filter(|class| **class >= 0).count();
        all.iter().filter(|c| **c == class).count() as f32 / known as f32
    };
    assert!(share(chairs, 2) > 0.6 && share(tables, 0) > 0.6, "{:?}", classified.class);
    assert_eq!(share(&classified.class, 1), 0.0, "nothing was called a wall");
    let (encoder_id, prompts) = embedded(folder.path(), &["table", "wall", "chair"]);
    let negatives = Vec::new();
    let classes = Sought::Embeddings { encoder_id, prompts, negatives };
    let in_numbers = ClassifyQuestion { classes, ..asked.clone() };
    for reply in [
        server.client.classify(&in_numbers).await.unwrap(),
        http.classify(&asked).await.unwrap(),
        http.classify(&in_numbers).await.unwrap(),
    ] {
        assert_eq!((&reply.class, reply.epoch), (&classified.class, classified.epoch));
        assert_eq!(bits(&reply.score), bits(&classified.score));
    }
    server.stop().await.0.unwrap();
}

/// An image of heat says what points of its surfaces are scored, over both transports.
#[tokio::test(flavor = "multi_thread")]
async fn heat_is_drawn_beside_color() {
    let folder = words();
    let server = mapped(folder.path()).await;
    let http = HttpClient::new(&format!("http://{}", server.http)).unwrap();
    let kind = |output| ImageKind { output, encoding: Encoding::F32 };
    let camera = camera(25);
    let images = [Output::Heat, Output::Depth, Output::Color].map(kind).to_vec();
    let text = Some(Sought::words(&["seat"]));
    let asked = ImageQuestion { text: text.clone(), ..ImageQuestion::new(camera, images) };
    let reply = server.client.render(&asked).await.unwrap();
    assert_eq!(http.render(&asked).await.unwrap().images, reply.images);
    let numbers = |at: usize| -> Vec<f32> {
        let (numbers, _) = reply.images[at].1.as_chunks::<4>();
        numbers.iter().map(|b| f32::from_le_bytes(*b)).collect()
    };
    let (heat, depth) = (numbers(0), numbers(1));
    let k = camera.intrinsics;
    let place = |(at, z): (usize, &f32)| {
        let (u, v) = (at as u32 % k.width, at as u32 / k.width);
        let own = k.direction(u as f32, v as f32) * *z;
        camera.world_from_camera.transform(own.as_dvec3()).as_vec3()
    };
    let points: Vec<Vec3> = depth.iter().enumerate().map(place).collect();
    let fields = Fields { text_score: true, ..Fields::NONE };
    let asked = PointsQuestion { fields, text, ..PointsQuestion::new(points) };
    let scores = server.client.ask(&asked).await.unwrap().answers.text_score;
    let (mut compared, mut warm) = (0, 0);
    for (at, (heat, score)) in
        heat.iter().zip(&scores).enumerate().filter(|(at, _)| depth[*at] > 0.0)
    {
        if !heat.is_nan() && !score.is_nan() {
            compared += 1;
            assert!((heat - score).abs() < 0.05, "{at}: {heat} {score}");
            warm += usize::from(*heat > 0.9);
        }
    }
    assert!(compared * 3 > heat.len() && warm * 8 > heat.len(), "{warm} of {compared}");

    let unasked = ImageQuestion::new(camera, vec![kind(Output::Heat)]);
    for error in [server.client.render(&unasked).await, http.render(&unasked).await] {
        assert!(error.expect_err("no text").to_string().starts_with("text: is required"));
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn questions_that_nobody_can_answer_say_why_over_both_transports() {
    let folder = words();
    let server = mapped(folder.path()).await;
    let http = HttpClient::new(&format!("http://{}", server.http)).unwrap();
    let (id, prompts) = embedded(folder.path(), &["chair"]);
    let embeddings = |encoder_id: &str, prompts: &[Vec<f32>]| Sought::Embeddings {
        encoder_id: encoder_id.into(),
        prompts: prompts.to_vec(),
        negatives: Vec::new(),
    };
    let find = FindQuestion::new;
    let (stale, wrong) = (Status::FailedPrecondition, Status::InvalidArgument);
    let cases: [(FindQuestion, Status, &[&str]); 10] = [
        (find(Sought::words(&[])), wrong, &["prompts: at least one"]),
        (find(Sought::words(&["chair", " "])), wrong, &["prompts[1]: is empty"]),
        (find(Sought::words(&["nothing"])), wrong, &["prompts[0]: has no word"]),
        (find(Sought::words(&["chair"; 65])), wrong, &["prompts: are 65", "64"]),
        (find(embeddings("clip", &prompts)), stale, &["encoder_id: ", "'clip'", &id]),
        (find(embeddings(&id, &[vec![1.0; 3]])), wrong, &["prompts[0]: "]),
        (find(embeddings(&id, &[vec![0.0; 8]])), wrong, &["prompts[0]: "]),
        (
            FindQuestion { top_k: 1001, ..find(Sought::words(&["chair"])) },
            wrong,
            &["top_k: 1001", "1000"],
        ),
        (
            FindQuestion { min_score: Some(2.0), ..find(Sought::words(&["chair"])) },
            wrong,
            &["min_score: 2", "-1..=1"],
        ),
        (
            FindQuestion { min_epoch: 99, ..find(Sought::words(&["chair"])) },
            stale,
            &["min_epoch: 99"],
        ),
    ];
    for (question, status, words) in cases {
        for error in [server.client.find(&question).await, http.find(&question).await] {
            let error = error.expect_err(words[0]);
            let said = error.to_string();
            // What cannot be whole in JSON is refused there with the limits of JSON.
            assert_eq!(error.status(), status, "{said}");
            for word in words {
                assert!(said.contains(word), "{word} in {said}");
            }
        }
    }
    let text = Some(Sought::words(&["nothing"]));
    let fields = Fields { text_score: true, ..Fields::NONE };
    let asked = PointsQuestion { fields, text, ..PointsQuestion::new(seen_points()) };
    for error in [server.client.ask(&asked).await, http.ask(&asked).await] {
        assert!(error.expect_err("a word").to_string().starts_with("text.prompts[0]: has no"));
    }
    let asked = PointsQuestion { text: None, ..asked };
    for error in [server.client.ask(&asked).await, http.ask(&asked).await] {
        assert!(error.expect_err("no text").to_string().starts_with("text: is required"));
    }
    server.stop().await.0.unwrap();
}

/// A map without language, and a server without an encoder.
#[tokio::test(flavor = "multi_thread")]
async fn words_need_a_map_of_language_and_an_encoder() {
    let folder = words();
    let (id, _) = embedded(folder.path(), &[]);
    let server = start(|settings| with_encoder(settings, folder.path())).await;
    let asked = FindQuestion::new(Sought::words(&["chair"]));
    let error = server.client.find(&asked).await.expect_err("nothing yet").to_string();
    assert!(error.contains("no language yet"), "{error}");
    let encoders = server.service.encoders(DEFAULT_MAP).unwrap();
    assert_eq!((encoders.server.map(|e| e.encoder_id.to_string()), encoders.map), (Some(id), None));
    server.stop().await.0.unwrap();

    let server = start(|_| {}).await;
    let acks = verdicts(&server, vec![featured_frame(1, "clip", 8)]).await;
    assert_eq!(acks[0].status(), FrameStatus::Integrated);
    let error = server.client.find(&asked).await.expect_err("no encoder").to_string();
    assert!(error.contains("encoder.kind") && error.contains("'clip'"), "{error}");
    let acks = verdicts(&server, vec![featured_frame(2, "siglip", 8)]).await;
    assert_refused(&acks[0], "features.encoder_id", &["'siglip'", "the map has 8 of 'clip'"]);
    let mut client = v1::language_client::LanguageClient::new(server.channel.clone());
    let request = v1::ListEncodersRequest { map_id: DEFAULT_MAP.into() };
    let reply = client.list_encoders(request).await.unwrap().into_inner();
    let clip = v1::Encoder { encoder_id: "clip".into(), dimension: 8 };
    assert_eq!((reply.server, reply.map), (None, Some(clip)));
    server.stop().await.0.unwrap();
}
