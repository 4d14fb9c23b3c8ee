//! A map changed by hand: what was seen is forgotten, known geometry is put in.

use glam::Vec3;

use super::mapper::Mapper;
use crate::config::Prior;
use crate::error::{Error, Result};
use crate::geometry::{MAX_COORDINATE_M, Region, Solid};
use crate::surface::{Forget, Lattice, Lost, Stamping, SurfaceChange};

/// The source that geometry has whose giver names none.
pub const STAMP_ROBOT: &str = "stamp";

/// Cells of surfels that the surface of one stamp may pass, and cells of evidence of the box around it.
const MAX_SURFACE_CELLS: f64 = 1_048_576.0;
const MAX_BOX_CELLS: f64 = 2_097_152.0;
/// Bytes of a robot's id.
const MAX_ROBOT_ID: usize = 256;

/// A change by hand.
#[derive(Debug, Clone)]
pub enum Edit {
    Clear(Clear),
    Stamp(Stamp),
}

/// What is to be forgotten: what all of the conditions that are there say. At least one must be.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Clear {
    pub region: Option<Region>,
    /// What only this robot saw.
    pub robot_id: Option<String>,
    /// What was last seen before this, Unix ns.
    pub older_than_ns: Option<i64>,
}

/// Geometry that is known.
#[derive(Debug, Clone)]
pub struct Stamp {
    pub solid: Solid,
    pub stamping: Stamping,
    /// sRGB within 0..1, of a surface that is added.
    pub color: Option<Vec3>,
    /// Under whose name it is in the map; [`STAMP_ROBOT`] if nobody else is named.
    pub robot_id: String,
}

/// What an edit did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Edited {
    /// The first epoch that holds it.
    pub epoch: u64,
    pub surfels_removed: u64,
    /// New ones, and those that took another's place.
    pub surfels_added: u64,
    /// Cells of evidence that became unknown, and such that were told occupied or free.
    pub cells_forgotten: u64,
    pub cells_told: u64,
    /// Views that training had kept of a robot.
    pub key_frames_dropped: u64,
}

impl Edit {
    /// Refuses what no map could do.
    pub fn check(&self) -> Result<()> {
        match self {
            Self::Clear(clear) => clear.check(),
            Self::Stamp(stamp) => stamp.check(),
        }
    }
}

impl Clear {
    fn check(&self) -> Result<()> {
        if *self == Self::default() {
            let problem = "one of box, sphere, robot_id and older_than_ns is required; \
                           a reset empties the whole map";
            return Err(Error::invalid("clear", problem));
        }
        match &self.region {
            Some(Region::Box(aabb)) => {
                check_place("box.min", aabb.min)?;
                check_place("box.max", aabb.max)?;
                if aabb.is_empty() {
                    let problem = format!("{} must not be below box.min {}", aabb.max, aabb.min);
                    return Err(Error::invalid("box.max", problem));
                }
            }
            Some(Region::Sphere { center, radius_m }) => check_sphere(*center, *radius_m)?,
            None => {}
        }
        self.robot_id.as_deref().map_or(Ok(()), check_robot)
    }
}

impl Stamp {
    fn check(&self) -> Result<()> {
        check_robot(&self.robot_id)?;
        match &self.solid {
            Solid::Box { world_from_box, size_m } => {
                let name_it = |error: Error| match error {
                    Error::InvalidArgument { field, problem }
                    | Error::Frame { field, problem, .. } => {
                        let part = field.rsplit('.').next().unwrap_or_default();
                        Error::invalid(format!("box.world_from_box.{part}"), problem)
                    }
                    other => other,
                };
                world_from_box.check_within_reach().map_err(name_it)?;
                let range = 0.0..=MAX_COORDINATE_M as f32;
                if size_m.to_array().iter().any(|s| *s == 0.0 || !range.contains(s)) {
                    let problem = format!("{size_m} must be above 0 and at most {} m", range.end());
                    return Err(Error::invalid("box.size_m", problem));
                }
            }
            Solid::Sphere { center, radius_m } => check_sphere(*center, *radius_m)?,
            Solid::Mesh(mesh) => {
                if self.stamping == Stamping::Free && !mesh.has_inside() {
                    let problem = "must be closed to be free: some edge has a triangle on one side \
                                   alone";
                    return Err(Error::invalid("mesh.triangles", problem));
                }
            }
        }
        match self.color {
            Some(color) if !color.to_array().iter().all(|c| (0.0..=1.0).contains(c)) => {
                Err(Error::invalid("color", format!("{color} must be within 0..1")))
            }
            _ => Ok(()),
        }
    }

    /// Refuses what would keep the map's thread busy for too long.
    fn check_extent(&self, surfel_m: f32, cell_m: f32) -> Result<()> {
        let surface = self.solid.area_m2() / f64::from(surfel_m * surfel_m);
        if surface > MAX_SURFACE_CELLS {
            let most = MAX_SURFACE_CELLS * f64::from(surfel_m * surfel_m);
            let problem =
                format!("a surface of {:.0} m² is more than {most:.0}", self.solid.area_m2());
            return Err(Error::invalid("geometry", problem));
        }
        let size = self.solid.bounds().size().as_dvec3() / f64::from(cell_m) + 1.0;
        if size.element_product() > MAX_BOX_CELLS {
            let most = MAX_BOX_CELLS * f64::from(cell_m).powi(3);
            let problem = format!("the box around it holds more than {most:.0} m³");
            return Err(Error::invalid("geometry", problem));
        }
        Ok(())
    }
}

fn check_place(field: &str, place: Vec3) -> Result<()> {
    let bound = MAX_COORDINATE_M as f32;
    if place.is_finite() && place.abs().max_element() <= bound {
        return Ok(());
    }
    Err(Error::invalid(field, format!("{place} must be finite and within {bound} m of the origin")))
}

fn check_sphere(center: Vec3, radius_m: f32) -> Result<()> {
    check_place("sphere.center", center)?;
    let bound = MAX_COORDINATE_M as f32;
    if radius_m > 0.0 && radius_m <= bound {
        return Ok(());
    }
    Err(Error::invalid(
        "sphere.radius_m",
        format!("{radius_m} must be above 0 and at most {bound}"),
    ))
}

fn check_robot(robot_id: &str) -> Result<()> {
    if (1..=MAX_ROBOT_ID).contains(&robot_id.len()) {
        return Ok(());
    }
    let problem = format!("{} bytes; must be 1 to {MAX_ROBOT_ID}", robot_id.len());
    Err(Error::invalid("robot_id", problem))
}

impl Mapper {
    /// Changes the map by hand. On an error it is as before, unless the backend is lost.
    pub fn edit(&mut self, edit: &Edit) -> Result<Edited> {
        edit.check()?;
        let edited = match edit {
            Edit::Clear(clear) => self.clear(clear)?,
            Edit::Stamp(stamp) => self.stamp(stamp)?,
        };
        self.changed = true;
        // What was learned around may be void now.
        self.idle_steps = 0;
        Ok(Edited { epoch: self.stats.epoch + 1, ..edited })
    }

    fn clear(&mut self, clear: &Clear) -> Result<Edited> {
        let robot = match &clear.robot_id {
            Some(id) => Some(self.robots.find(id)?),
            None => None,
        };
        let timeline = &self.timeline;
        let is_old = |number| clear.older_than_ns.is_none_or(|s| timeline.is_before(number, s));
        let what = Forget { region: clear.region, robot, is_old: &is_old };
        let rows = self.topology.rows() as u32;
        let (change, lost) = self.surface.forget(&what, &mut self.topology, &self.pool);
        let is_all = clear.region.is_none() && clear.older_than_ns.is_none();
        let dropped = robot.filter(|_| is_all).map_or(0, |r| self.key_frames.forget_robot(r));
        self.follow_edit(change, &lost, rows)?;
        Ok(Edited {
            surfels_removed: lost.surfels,
            cells_forgotten: lost.known_cells,
            key_frames_dropped: dropped,
            ..Edited::default()
        })
    }

    fn stamp(&mut self, stamp: &Stamp) -> Result<Edited> {
        let cell_m = Lattice::new(&self.config).size_m(Lattice::new(&self.config).cell);
        if self.config.prior == Prior::Learned {
            let problem = "map.prior: distances that are learned alone cannot take geometry";
            return Err(Error::FailedPrecondition(problem.into()));
        }
        stamp.check_extent(self.config.surfel_size_m, cell_m)?;
        self.grant_room()?;
        self.timeline.count_edit();
        let number = self.timeline.number(self.stats.frames);
        self.timeline.note(number, self.newest_stamp_ns);
        let source = (self.robots.number(&stamp.robot_id), number);
        let rows = self.topology.rows() as u32;
        let Stamp { solid, stamping, color, .. } = stamp;
        let (change, stamped) =
            self.surface.stamp(solid, *stamping, *color, source, &mut self.topology, &self.pool);
        self.follow_edit(change, &stamped.lost, rows)?;
        Ok(Edited {
            surfels_removed: stamped.lost.surfels,
            surfels_added: stamped.surfels,
            cells_told: stamped.cells,
            ..Edited::default()
        })
    }

    /// Takes codes with the surfaces that they belong to, and tells the backend and the next view.
    fn follow_edit(&mut self, change: SurfaceChange, lost: &Lost, rows: u32) -> Result<()> {
        if let Some(language) = &mut self.language {
            language.forget(&lost.rows(&language.band));
            self.changed_codes.extend(language.take_changed());
        }
        self.follow(change, rows)
    }
}
