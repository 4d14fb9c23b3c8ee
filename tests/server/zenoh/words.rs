//! Words on a topic of ROS 2.

use glam::Vec3;
use orenx::service::{ClassifyQuestion, DEFAULT_MAP, Sought};
use orenx::wire::ros2::{PointCloud2, Text, Type, decode};

use super::ros2::Robot;
use super::router::Router;
use super::start_on;
use crate::server::language::{labelled_frame, verdicts, with_encoder};
use crate::support::encoder::words;

#[tokio::test(flavor = "multi_thread")]
async fn words_on_a_topic_are_answered_by_the_points_that_fit() {
    let router = Router::start();
    let folder = words();
    let (server, client) = start_on(&router, |settings| {
        settings.ros2.bridge = "dds-bridge".into();
        with_encoder(settings, folder.path());
    })
    .await;
    let frames = [0, 25, 50, 75].map(labelled_frame).to_vec();
    assert_eq!(verdicts(&server, frames).await.len(), 4);
    let robot = Robot { client, prefix: "", is_rmw: false };
    let (mut clouds, _clouds) = robot.hear("orenx/matches", &Type::POINT_CLOUD).await;
    robot.put("orenx/text", &Text { data: "seat".into() }).await;
    let sample = clouds.recv().await.unwrap();
    let payload = sample.payload().to_bytes();
    let cloud: PointCloud2<'_> = decode(&payload).unwrap();
    assert!(cloud.width > 50 && cloud.fields.last().is_some_and(|field| field.name == "score"));
    let number = |p: &[u8], at: usize| f32::from_le_bytes(p[at..at + 4].try_into().unwrap());
    let rows = cloud.data.chunks_exact(cloud.point_step as usize);
    let (points, scores): (Vec<Vec3>, Vec<f32>) =
        rows.map(|p| (Vec3::new(number(p, 0), number(p, 4), number(p, 8)), number(p, 16))).unzip();
    assert!(scores.iter().all(|score| (0.5..=1.0).contains(score)), "what fits alone");
    // Which of the classes is there, says another verb.
    let question = ClassifyQuestion {
        map_id: DEFAULT_MAP.into(),
        points,
        classes: Sought::words(&["chair", "table"]),
        min_epoch: 0,
        max_age: None,
    };
    let classes = server.client.classify(&question).await.unwrap().class;
    let chairs = classes.iter().filter(|class| **class == 0).count();
    assert!(chairs * 10 > classes.len() * 9, "{chairs} of {}", classes.len());
    drop(robot);
    server.stop().await.0.unwrap();
}
