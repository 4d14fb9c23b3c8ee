//! The threads that draw images: one image at a time, however many are asked for, so that the cores
//! never have more than one of them between the questions.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use tokio::sync::Semaphore;

use super::image::{ImageKind, ImageQuestion};
use crate::config::{BackendChoice, Renderer};
use crate::error::{Error, Result};
use crate::map::{
    MapView, Output, Painter, RenderSettings, Rendering, Scorer, Subject, render_with,
};
use crate::threads::Urgency;

/// Questions that wait for their turn or are drawn.
const PLACES: usize = 32;
/// A map that nobody had drawn in this time is let go of by the GPU, with the view that it holds on to.
const FORGET: Duration = Duration::from_secs(30);

/// A pool of drawing threads and the line before it, first come first served.
pub(super) struct Studio {
    pool: Arc<ThreadPool>,
    easel: Arc<Easel>,
    turn: Arc<Semaphore>,
    places: Semaphore,
}

/// What draws by tiles.
struct Easel {
    hand: Mutex<Hand>,
    /// Whether somebody looks after what is forgotten.
    is_tended: AtomicBool,
}

/// The GPU, if there is one to draw with: it is opened for the first image.
enum Hand {
    Unknown(BackendChoice),
    Gpu(Box<Painter>),
    Cpu,
}

/// Drops a drawing whose reader has gone, at its next tile.
struct CancelOnDrop(Arc<AtomicBool>);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

impl Studio {
    /// With `threads` drawing threads, and a GPU as the server's backend says.
    pub(super) fn start(threads: usize, backend: BackendChoice) -> Result<Self> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|index| format!("orenx-render-{index}"))
            // A question that arrives meanwhile takes the processor at once.
            .start_handler(|_| Urgency::Patient.declare())
            .build()
            .map_err(|e| Error::Internal(format!("a drawing thread did not start: {e}")))?;
        Ok(Self {
            pool: Arc::new(pool),
            easel: Arc::new(Easel {
                hand: Mutex::new(Hand::Unknown(backend)),
                is_tended: AtomicBool::new(false),
            }),
            turn: Arc::new(Semaphore::new(1)),
            places: Semaphore::new(PLACES),
        })
    }

    /// The images of a checked question, its text as the view is asked for it, and how long it waited
    /// for its turn. Dropping the future
    /// leaves the rest of the drawing at its next tile.
    pub(super) async fn draw(
        &self,
        view: Arc<MapView>,
        question: ImageQuestion,
        text: Option<Scorer>,
    ) -> Result<(Vec<(ImageKind, Vec<u8>)>, Duration)> {
        let asked = Instant::now();
        let _place = self.places.try_acquire().map_err(|_| Error::ResourceExhausted {
            what: "images that wait to be drawn".into(),
            limit: format!("the limit is {PLACES}"),
        })?;
        let turn = self.turn.clone().acquire_owned().await.map_err(internal)?;
        let waited = asked.elapsed();
        let left = Arc::new(AtomicBool::new(false));
        let _cancel = CancelOnDrop(left.clone());
        let (pool, easel) = (self.pool.clone(), self.easel.clone());
        let runtime = tokio::runtime::Handle::current();
        let drawing = tokio::task::spawn_blocking(move || {
            // Kept until the drawing has stopped, even if nobody waits for it.
            let _turn = turn;
            let drawn = || images(&view, &question, text.as_ref(), &pool, &easel, &left);
            let images = catch_unwind(AssertUnwindSafe(drawn))
                .unwrap_or_else(|_| Err(Error::Internal("this image made the server fail".into())));
            tend(&easel, &runtime);
            images
        });
        Ok((drawing.await.map_err(internal)??, waited))
    }
}

fn internal(error: impl std::fmt::Display) -> Error {
    Error::Internal(format!("an image was not drawn: {error}"))
}

impl Easel {
    /// Draws on the GPU; `Err` if there is none to draw with. One that fails is given up, and the CPU
    /// draws from then on.
    fn draw(
        &self,
        subject: &Subject<'_>,
        pool: &ThreadPool,
        interrupted: &(dyn Fn() -> bool + Sync),
    ) -> std::result::Result<Option<Rendering>, ()> {
        let mut hand = self.hand.lock().unwrap_or_else(PoisonError::into_inner);
        if let Hand::Unknown(choice) = *hand {
            let painter = Painter::open(choice).unwrap_or_else(|error| {
                tracing::warn!(%error, "images are drawn on the CPU: the GPU cannot draw them");
                None
            });
            *hand = painter.map_or(Hand::Cpu, |painter| Hand::Gpu(Box::new(painter)));
        }
        let Hand::Gpu(painter) = &mut *hand else { return Err(()) };
        match painter.render(subject, pool, interrupted) {
            Ok((image, _)) => Ok(image),
            Err(error) => {
                let gpu = painter.adapter();
                tracing::warn!(%error, gpu, "images are drawn on the CPU from now on: the GPU failed");
                *hand = Hand::Cpu;
                Err(())
            }
        }
    }
}

/// Sees to it that the GPU lets go of what nobody has drawn.
fn tend(easel: &Arc<Easel>, runtime: &tokio::runtime::Handle) {
    let holds = {
        let hand = easel.hand.lock().unwrap_or_else(PoisonError::into_inner);
        matches!(*hand, Hand::Gpu(_))
    };
    if !holds || easel.is_tended.swap(true, Relaxed) {
        return;
    }
    let easel = Arc::downgrade(easel);
    runtime.spawn(async move {
        loop {
            tokio::time::sleep(FORGET / 3).await;
            let Some(easel) = easel.upgrade() else { return };
            // One that draws at this moment has nothing to forget yet.
            if let Ok(mut hand) = easel.hand.try_lock() {
                let is_held = match &mut *hand {
                    Hand::Gpu(painter) => painter.forget(FORGET),
                    Hand::Unknown(_) | Hand::Cpu => false,
                };
                if !is_held {
                    easel.is_tended.store(false, Relaxed);
                    return;
                }
            }
        }
    });
}

fn images(
    view: &Arc<MapView>,
    question: &ImageQuestion,
    text: Option<&Scorer>,
    pool: &ThreadPool,
    easel: &Easel,
    left: &AtomicBool,
) -> Result<Vec<(ImageKind, Vec<u8>)>> {
    let channels = Output::channels(question.images.iter().map(|kind| kind.output));
    let settings = RenderSettings { renderer: question.renderer, ..RenderSettings::default() };
    let interrupted = || left.load(Relaxed);
    let camera = &question.camera;
    let subject = Subject { view, camera, channels, settings: &settings, text };
    let on_gpu = match question.renderer {
        Renderer::Tile => easel.draw(&subject, pool, &interrupted),
        Renderer::Ray => Err(()),
    };
    let rendering = on_gpu
        .unwrap_or_else(|()| {
            render_with(view, camera, channels, &settings, text, pool, &interrupted)
        })
        .ok_or_else(|| Error::Unavailable("nobody waits for this image any more".into()))?;
    let encode = |kind: &ImageKind| Ok((*kind, rendering.encode(kind.output, kind.encoding)?));
    pool.install(|| question.images.par_iter().map(encode).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{MapConfig, MapSettings};
    use crate::geometry::{Intrinsics, Pose};
    use crate::map::{Camera, Encoding, Mapper};

    fn view() -> Arc<MapView> {
        let config = MapConfig::from_settings(&MapSettings::default()).expect("defaults");
        Mapper::new(config).expect("an empty map").publish()
    }

    fn question(width: u32) -> ImageQuestion {
        let intrinsics = Intrinsics { fx: 9.0, fy: 9.0, cx: 4.0, cy: 4.0, width, height: 8 };
        let camera = Camera { world_from_camera: Pose::IDENTITY, intrinsics };
        let kind = |output| ImageKind { output, encoding: Encoding::U8 };
        ImageQuestion::new(camera, vec![kind(Output::Unknown), kind(Output::Color)])
    }

    #[tokio::test]
    async fn images_come_in_the_order_of_the_question() {
        let studio = Studio::start(2, BackendChoice::Cpu).expect("threads");
        let (images, _waited) = studio.draw(view(), question(8), None).await.expect("drawn");
        let sizes: Vec<_> = images.iter().map(|(kind, bytes)| (kind.output, bytes.len())).collect();
        assert_eq!(sizes, [(Output::Unknown, 64), (Output::Color, 192)]);
        assert_eq!(images[0].1, [1; 64], "an empty map knows nothing");
        assert_eq!(
            (studio.turn.available_permits(), studio.places.available_permits()),
            (1, PLACES)
        );
    }

    #[tokio::test]
    async fn one_is_drawn_at_a_time_and_the_line_has_an_end() {
        let studio = Studio::start(1, BackendChoice::Cpu).expect("a thread");
        let turn = studio.turn.clone().acquire_owned().await.expect("open");
        let view = view();
        let mut waiting: Vec<_> =
            (0..PLACES).map(|_| Box::pin(studio.draw(view.clone(), question(8), None))).collect();
        for drawing in &mut waiting {
            let polled = std::future::poll_fn(|context| {
                std::task::Poll::Ready(drawing.as_mut().poll(context).is_pending())
            });
            assert!(polled.await, "the turn is taken");
        }
        let error =
            studio.draw(view.clone(), question(8), None).await.expect_err("full").to_string();
        assert!(error.contains("the limit is 32"), "{error}");
        waiting.truncate(1);
        drop(turn);
        for drawing in waiting {
            drawing.await.expect("its turn");
        }
    }

    #[tokio::test]
    async fn a_gpu_draws_and_if_it_fails_the_cpu_does() {
        let studio = Studio::start(1, BackendChoice::Gpu).expect("a thread");
        let view = view();
        let (on_gpu, _) = studio.draw(view.clone(), question(8), None).await.expect("drawn");
        assert!(studio.easel.is_tended.load(Relaxed), "the view is let go of some time");
        let lock = || studio.easel.hand.lock().expect("nobody failed");
        match &mut *lock() {
            Hand::Gpu(painter) => painter.break_down("taken away"),
            _ => panic!("software will do to draw with"),
        }
        let (on_cpu, _) = studio.draw(view, question(8), None).await.expect("drawn");
        assert_eq!(on_gpu, on_cpu);
        assert!(matches!(*lock(), Hand::Cpu), "a GPU that failed is given up");
    }

    #[test]
    fn a_drawing_that_nobody_waits_for_is_left() {
        let studio = Studio::start(1, BackendChoice::Cpu).expect("a thread");
        let error = images(
            &view(),
            &question(8),
            None,
            &studio.pool,
            &studio.easel,
            &AtomicBool::new(true),
        );
        assert!(error.is_err());
    }
}
