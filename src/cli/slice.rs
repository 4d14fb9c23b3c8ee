//! `orenx slice`: a picture of the distance field on a plane.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use glam::Vec3;
use image::ImageFormat;

use super::numbers::numbers;
use super::open::open_view;
use crate::map::{Plane, draw_slice, query_pool, slice};
use crate::storage::write_file;

/// Draw the signed distance on a plane (PNG)
#[derive(Debug, Args)]
pub struct SliceArgs {
    /// Map file
    pub map: PathBuf,
    /// Height of a horizontal plane, m
    #[arg(
        long,
        value_name = "Z",
        allow_hyphen_values = true,
        required_unless_present = "plane",
        conflicts_with = "plane"
    )]
    pub z: Option<f32>,
    /// Plane of the points p with n · p = d (metres), drawn as seen from where n points to
    #[arg(long, value_name = "NX,NY,NZ,D", allow_hyphen_values = true, value_parser = parse_plane)]
    pub plane: Option<Plane>,
    #[arg(long, value_name = "FILE.png")]
    pub out: PathBuf,
}

impl SliceArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let plane = match (self.plane, self.z) {
            (Some(plane), _) => plane,
            (None, z) => Plane::horizontal(z.unwrap_or(f32::NAN))?,
        };
        let view = open_view(&self.map)?;
        let pool = query_pool(0)?;
        let query = |points: &[_], fields| view.query(points, fields);
        let slice = slice(&query, &view.bounds(), plane, &pool)?;
        let image = draw_slice(&slice);
        write_file(&self.out, |out| {
            image.write_to(out, ImageFormat::Png).map_err(std::io::Error::other)
        })?;
        let (width, height) = (image.width(), image.height());
        writeln!(std::io::stdout(), "{}: {width}x{height} pixels", self.out.display())?;
        Ok(())
    }
}

fn parse_plane(text: &str) -> Result<Plane, String> {
    let [x, y, z, d] = numbers(text, "nx,ny,nz,d")?;
    Plane::new(Vec3::new(x, y, z), d).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_parsed_or_refused_with_the_reason() {
        let plane = parse_plane("0,0,2,1.5").expect("a plane");
        assert_eq!((plane.normal, plane.offset_m), (Vec3::Z, 1.5));
        for (text, reason) in [("0,0,1", "4 numbers"), ("0,0,0,1", "length"), ("a,0,0,1", "'a'")] {
            let error = parse_plane(text).expect_err(text);
            assert!(error.contains(reason), "{error}");
        }
    }
}
