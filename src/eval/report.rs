//! The evaluation report: a stable JSON format, and the paper's geometry table.

use std::fmt;

use serde::Serialize;

/// What `orenx eval --report` writes; sections that do not apply are absent, and a mean over
/// nothing is `null`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Report {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Geometry>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub occupancy: Option<Occupancy>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub images: Option<ImageErrors>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub language: Option<LanguageScores>,
}

/// Errors of the distance field and of the mesh.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Geometry {
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub field: Option<FieldErrors>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshErrors>,
}

/// Errors of the distance field, over known points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FieldErrors {
    pub sdf_mae_m: Ranges,
    /// The error that 95 % of the points stay below, m.
    pub sdf_p95_m: Ranges,
    pub gradient_mae_rad: Ranges,
    pub sign_accuracy_near: f64,
    pub sign_accuracy_near_observed: f64,
    pub known_share: KnownShare,
}

/// One figure by distance from the surface; `_observed`: the nearest surface was seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ranges {
    pub near: f64,
    pub near_observed: f64,
    pub far: f64,
    pub far_observed: f64,
    pub all: f64,
    pub all_observed: f64,
}

/// The share of the truth's points that the map knows, which every mean over known points leaves
/// out.
pub type KnownShare = Ranges;

/// Errors of the extracted mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MeshErrors {
    pub accuracy_m: f64,
    pub completion_m: f64,
    pub chamfer_m: f64,
    pub f_score_5cm: f64,
    pub f_score_2cm: f64,
}

/// How well the occupancy field classifies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Occupancy {
    pub accuracy: f64,
    pub known_share: f64,
}

/// Rendered views beside true ones: means over the images.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImageErrors {
    /// dB, over the pixels where both the map and the truth have depth, and over all.
    pub psnr_covered: f64,
    pub psnr_full: f64,
    pub ssim: f64,
    /// Over covered pixels, m.
    pub depth_l1_m: f64,
    pub depth_median_m: f64,
    /// The covered pixels among those where the truth has depth.
    pub coverage: f64,
    pub renderer: String,
    /// Only where the user gave a network.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lpips: Option<f64>,
    /// How fast the views were drawn. Not in the report, which is the same on every machine.
    #[serde(skip)]
    pub images_per_second: f64,
}

/// How well a map with language tells classes apart: at points of surfaces, and in unseen views.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LanguageScores {
    pub miou_3d: f64,
    pub macc_3d: f64,
    pub map_3d: f64,
    /// The share of the places that the map knows, which the means leave out.
    pub known_share_3d: f64,
    pub miou_2d: f64,
    pub macc_2d: f64,
    pub map_2d: f64,
    pub known_share_2d: f64,
    /// Of decoded features with the embedding of the true class.
    pub cosine: f64,
    /// The classes that count in 3D.
    pub classes: usize,
    pub atoms: usize,
    /// Of codes and atoms as they are published.
    pub bytes: u64,
}

/// The paper's geometry table, in its units, with what was known beside the means.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(mesh) = self.geometry.as_ref().and_then(|g| g.mesh.as_ref()) {
            writeln!(f, "{:<26}{:>12}", "Mesh", "")?;
            single(f, "Accuracy [cm]", mesh.accuracy_m * 100.0, 2)?;
            single(f, "Completion [cm]", mesh.completion_m * 100.0, 2)?;
            single(f, "Chamfer [cm]", mesh.chamfer_m * 100.0, 2)?;
            single(f, "F-score 5 cm [%]", mesh.f_score_5cm * 100.0, 2)?;
            single(f, "F-score 2 cm [%]", mesh.f_score_2cm * 100.0, 2)?;
            writeln!(f)?;
        }
        if let Some(field) = self.geometry.as_ref().and_then(|g| g.field.as_ref()) {
            field_table(f, field)?;
        }
        if let Some(occupancy) = &self.occupancy {
            let (accuracy, known) = (occupancy.accuracy * 100.0, occupancy.known_share * 100.0);
            writeln!(
                f,
                "{:<26}{:>12}{:>12}{:>12}",
                "Occupancy accuracy [%]",
                number(accuracy, 2),
                "",
                number(known, 2)
            )?;
        }
        if let Some(images) = &self.images {
            writeln!(f)?;
            image_table(f, images)?;
        }
        if let Some(language) = &self.language {
            writeln!(f)?;
            language_table(f, language)?;
        }
        Ok(())
    }
}

fn image_table(f: &mut fmt::Formatter<'_>, images: &ImageErrors) -> fmt::Result {
    writeln!(f, "{:<26}{:>12}", "Novel views", images.renderer)?;
    single(f, "PSNR, covered [dB]", images.psnr_covered, 2)?;
    single(f, "PSNR, all [dB]", images.psnr_full, 2)?;
    single(f, "SSIM", images.ssim, 4)?;
    if let Some(lpips) = images.lpips {
        single(f, "LPIPS", lpips, 4)?;
    }
    single(f, "Depth L1 [mm]", images.depth_l1_m * 1e3, 2)?;
    single(f, "Depth, median [mm]", images.depth_median_m * 1e3, 2)?;
    single(f, "Coverage [%]", images.coverage * 100.0, 2)
}

fn language_table(f: &mut fmt::Formatter<'_>, language: &LanguageScores) -> fmt::Result {
    let LanguageScores { classes, atoms, bytes, .. } = language;
    writeln!(f, "{:<26}{:>12}{:>12}", "Language", "3D", "2D")?;
    for (name, surface, image) in [
        ("mIoU [%]", language.miou_3d, language.miou_2d),
        ("mAcc [%]", language.macc_3d, language.macc_2d),
        ("mAP [%]", language.map_3d, language.map_2d),
        ("Known [%]", language.known_share_3d, language.known_share_2d),
    ] {
        writeln!(
            f,
            "{name:<26}{:>12}{:>12}",
            number(surface * 100.0, 2),
            number(image * 100.0, 2)
        )?;
    }
    single(f, "Cosine", language.cosine, 3)?;
    single(f, "Codes and atoms [MB]", *bytes as f64 * 1e-6, 2)?;
    writeln!(f, "{:<26}{classes:>12}\n{:<26}{atoms:>12}", "Classes", "Atoms")
}

fn field_table(f: &mut fmt::Formatter<'_>, field: &FieldErrors) -> fmt::Result {
    let (mae, angle, known) = (&field.sdf_mae_m, &field.gradient_mae_rad, &field.known_share);
    writeln!(
        f,
        "{:<26}{:>12}{:>12}{:>12}{:>12}",
        "Field", "all points", "observed", "known [%]", "of observed"
    )?;
    let mut row = |name: &str, plain: f64, observed: f64, digits: usize, shares: (f64, f64)| {
        writeln!(
            f,
            "{name:<26}{:>12}{:>12}{:>12}{:>12}",
            number(plain, digits),
            number(observed, digits),
            number(shares.0 * 100.0, 2),
            number(shares.1 * 100.0, 2)
        )
    };
    let all = (known.all, known.all_observed);
    let near = (known.near, known.near_observed);
    let far = (known.far, known.far_observed);
    row("SDF MAE, All [cm]", mae.all * 100.0, mae.all_observed * 100.0, 3, all)?;
    row("SDF MAE, Near [cm]", mae.near * 100.0, mae.near_observed * 100.0, 3, near)?;
    row("SDF MAE, Far [cm]", mae.far * 100.0, mae.far_observed * 100.0, 3, far)?;
    row("Grad. MAE, All [rad]", angle.all, angle.all_observed, 3, all)?;
    row("Grad. MAE, Near [rad]", angle.near, angle.near_observed, 3, near)?;
    row("Grad. MAE, Far [rad]", angle.far, angle.far_observed, 3, far)?;
    let sign = (field.sign_accuracy_near * 100.0, field.sign_accuracy_near_observed * 100.0);
    row("Sign accuracy, Near [%]", sign.0, sign.1, 2, near)
}

fn single(f: &mut fmt::Formatter<'_>, name: &str, value: f64, digits: usize) -> fmt::Result {
    writeln!(f, "{name:<26}{:>12}", number(value, digits))
}

/// A mean over nothing prints as a dash.
fn number(value: f64, digits: usize) -> String {
    if value.is_finite() { format!("{value:.digits$}") } else { "-".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ranges(near_observed: f64) -> Ranges {
        Ranges {
            near: 0.004,
            near_observed,
            far: 0.01,
            far_observed: 0.009,
            all: 0.007,
            all_observed: f64::NAN,
        }
    }

    fn report() -> Report {
        Report {
            geometry: Some(Geometry {
                field: Some(FieldErrors {
                    sdf_mae_m: ranges(0.0035),
                    sdf_p95_m: ranges(0.01),
                    gradient_mae_rad: ranges(0.2),
                    sign_accuracy_near: 0.97,
                    sign_accuracy_near_observed: 0.98,
                    known_share: ranges(0.99),
                }),
                mesh: None,
            }),
            ..Report::default()
        }
    }

    #[test]
    fn json_has_the_stable_keys_and_no_absent_section() {
        let json = serde_json::to_value(report()).expect("plain data");
        let geometry = &json["geometry"];
        assert_eq!(geometry["sdf_mae_m"]["near_observed"], 0.0035);
        assert_eq!(geometry["gradient_mae_rad"]["near_observed"], 0.2);
        assert_eq!(geometry["known_share"]["near_observed"], 0.99);
        assert_eq!(geometry["sign_accuracy_near"], 0.97);
        assert!(geometry["sdf_mae_m"]["all_observed"].is_null(), "a mean over nothing");
        assert!(geometry.get("mesh").is_none() && json.get("occupancy").is_none());
        let mesh = MeshErrors {
            accuracy_m: 0.001,
            completion_m: 0.002,
            chamfer_m: 0.0015,
            f_score_5cm: 1.0,
            f_score_2cm: 0.9,
        };
        let only_mesh = Report {
            geometry: Some(Geometry { field: None, mesh: Some(mesh) }),
            occupancy: Some(Occupancy { accuracy: 0.9, known_share: 1.0 }),
            ..Report::default()
        };
        let json = serde_json::to_value(only_mesh).expect("plain data");
        assert_eq!(json["geometry"]["mesh"]["f_score_2cm"], 0.9);
        assert_eq!(json["occupancy"]["accuracy"], 0.9);
        assert!(json["geometry"].get("sdf_mae_m").is_none());
    }

    #[test]
    fn images_have_the_stable_keys_and_lpips_only_where_it_was_asked_for() {
        let mut images = ImageErrors {
            psnr_covered: 36.5,
            psnr_full: 30.25,
            ssim: 0.95,
            depth_l1_m: 0.0035,
            depth_median_m: 0.001,
            coverage: 0.99,
            renderer: "tile".into(),
            lpips: None,
            images_per_second: 9.0,
        };
        let report = |images| Report { images: Some(images), ..Report::default() };
        let json = serde_json::to_value(report(images.clone())).expect("plain data");
        let expected = serde_json::json!({ "images": {
            "psnr_covered": 36.5, "psnr_full": 30.25, "ssim": 0.95, "depth_l1_m": 0.0035,
            "depth_median_m": 0.001, "coverage": 0.99, "renderer": "tile",
        }});
        assert_eq!(json, expected);
        images.lpips = Some(0.125);
        let table = report(images.clone()).to_string();
        for line in
            ["PSNR, covered [dB]               36.50", "LPIPS                           0.1250"]
        {
            assert!(table.lines().any(|l| l == line), "{line} in\n{table}");
        }
        assert_eq!(serde_json::to_value(images).expect("plain data")["lpips"], 0.125);
    }

    #[test]
    fn language_has_the_stable_keys_and_a_table_of_both_kinds() {
        let language = LanguageScores {
            miou_3d: 0.5,
            macc_3d: 0.625,
            map_3d: 0.75,
            known_share_3d: 1.0,
            miou_2d: 0.25,
            macc_2d: 0.375,
            map_2d: f64::NAN,
            known_share_2d: 0.875,
            cosine: 0.9375,
            classes: 12,
            atoms: 64,
            bytes: 2_500_000,
        };
        let report = Report { language: Some(language), ..Report::default() };
        let expected = serde_json::json!({ "language": {
            "miou_3d": 0.5, "macc_3d": 0.625, "map_3d": 0.75, "known_share_3d": 1.0,
            "miou_2d": 0.25, "macc_2d": 0.375, "map_2d": null, "known_share_2d": 0.875,
            "cosine": 0.9375, "classes": 12, "atoms": 64, "bytes": 2_500_000,
        }});
        assert_eq!(serde_json::to_value(&report).expect("plain data"), expected);
        let table = report.to_string();
        for row in ["mIoU [%] 50.00 25.00", "mAP [%] 75.00 -", "Atoms 64", "Cosine 0.938"] {
            let is_row = |line: &str| line.split_whitespace().eq(row.split_whitespace());
            assert!(table.lines().any(is_row), "{row} in\n{table}");
        }
    }

    #[test]
    fn the_table_prints_centimetres_known_shares_and_dashes() {
        let table = report().to_string();
        let near = table.lines().find(|l| l.starts_with("SDF MAE, Near")).expect("the row");
        let cells: Vec<&str> = near.split_whitespace().skip(4).collect();
        assert_eq!(cells, ["0.400", "0.350", "0.40", "99.00"]);
        let all = table.lines().find(|l| l.starts_with("SDF MAE, All")).expect("the row");
        assert_eq!(all.split_whitespace().nth(5), Some("-"));
    }
}
