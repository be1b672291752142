use crate::common::golden::{Case, Tolerance::*};
use glam::{DMat3, DVec3};
use vbgs_studio::math::special::{digamma, ln_gamma, mv_digamma3, mv_ln_gamma3};
use vbgs_studio::math::sym3::Sym3;
use vbgs_studio::model::conjugate::niw::Niw;

#[test]
fn special_functions() {
    let case = Case::open("niw");
    let (x, a) = (case.f64("sf_x"), case.f64("sf_a"));
    type Row<'a> = (&'a str, &'a [f64], fn(f64) -> f64);
    let table: [Row; 4] = [
        ("sf_digamma", &x, digamma),
        ("sf_lgamma", &x, ln_gamma),
        ("sf_mvdigamma3", &a, mv_digamma3),
        ("sf_mvlgamma3", &a, mv_ln_gamma3),
    ];
    for (name, arguments, function) in table {
        let found: Vec<f64> = arguments.iter().map(|&v| function(v)).collect();
        case.check(name, &found, Rel(1e-14, 1.0));
    }
}

#[test]
fn normal_wishart_laws() {
    let case = Case::open("niw");
    let scales: Vec<Sym3> =
        case.rows::<9>("U").iter().map(|u| Sym3::from_mat3(DMat3::from_cols_array(u))).collect();
    let (n, kappa, m) = (case.f64("n"), case.f64("kappa"), case.rows::<3>("m"));
    let laws: Vec<Niw> = (0..24)
        .map(|i| Niw::new(DVec3::from_array(m[i]), kappa[i], scales[i], n[i]).unwrap())
        .collect();
    let condition: Vec<f64> = scales
        .iter()
        .map(|u| {
            let values = u.eigen().values;
            values.x / values.z
        })
        .collect();
    let x = case.rows::<3>("x");
    let relative = |cond: f64, v: f64| (f64::EPSILON * cond).max(1e-13) * v.abs().max(1.0);
    let column = |f: &dyn Fn(&Niw) -> f64| laws.iter().map(f).collect::<Vec<f64>>();
    for (name, found) in [
        ("logdet_u", column(&|l| l.ln_det_scale())),
        ("elogdet", column(&|l| l.expected_ln_det_precision())),
        ("e_mu_prec_mu", column(&|l| l.expected_mean_precision_mean())),
        ("log_z", column(&|l| l.ln_normaliser())),
    ] {
        case.check_each(name, &found, |i, v| relative(condition[i], v));
    }
    let ell: Vec<f64> =
        (0..96).map(|i| laws[i / 4].expected_ln_likelihood(DVec3::from_array(x[i]))).collect();
    case.check_each("ell", &ell, |i, v| relative(condition[i / 4], v));
    let kl: Vec<f64> = (0..24).map(|i| laws[i].kl(&laws[(i + 6) % 24])).collect();
    case.check_each("kl_next6", &kl, |i, v| relative(condition[i].max(condition[(i + 6) % 24]), v));
}
