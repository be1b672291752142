//! What is known of a component beside its splat.

use super::conjugate::posterior::ComponentPosterior;
use super::scene::photometric::PhotometricDeviations;
use crate::math::normalization::Normalization;

/// What is known of a component beside its splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ComponentAttributes {
    /// Points it has received, `N_k`; `None` for splats that no training stands behind.
    pub evidence: Option<f32>,
    /// Standard deviation of the position of what is drawn, world units: of the points' mean
    /// ([`ComponentPosterior::mean_deviation`]), or what photographs leave uncertain of the splat.
    pub uncertainty: Option<f32>,
    /// Mean ELBO, nats, of the points of the last frame that it has the largest share in; `None` if
    /// it has none, or where nobody asked for the sum.
    pub elbo: Option<f32>,
    /// Position in the run of the frame in which it first received points; `None` where that is not
    /// known, or before.
    pub birth: Option<u32>,
}

impl ComponentAttributes {
    /// Attributes of a component by its posterior; one without points has none.
    pub fn new(
        posterior: &ComponentPosterior,
        normalization: &Normalization,
        elbo: Option<f64>,
        birth: Option<u32>,
    ) -> Self {
        if posterior.count <= 0.0 {
            return Self::default();
        }
        Self {
            evidence: Some(posterior.count as f32),
            uncertainty: Some(posterior.mean_deviation(normalization) as f32),
            elbo: elbo.map(|e| e as f32),
            birth,
        }
    }

    /// The same of a component whose splat photographs have moved: they alone, since it began.
    pub fn photographed(self, found: Option<PhotometricDeviations>) -> Self {
        let uncertainty = found.map(|found| found.position() as f32).or(self.uncertainty);
        Self { uncertainty, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sym3::Sym3;
    use crate::model::conjugate::prior::Hyper;
    use crate::model::conjugate::statistics::Moments;
    use glam::DVec3;

    /// Four points around the initial mean, a unit apart on the first axis: the expected covariance
    /// is about that of the points, and their mean is known √4 times better than one of them.
    #[test]
    fn uncertainty_is_the_deviation_of_the_mean_in_world_units() {
        let moments = Moments {
            count: 4.0,
            second: Sym3::from_array([4.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            ..Moments::default()
        };
        let normalization = Normalization { offset: [0.0; 3], scale: [10.0, 2.0, 2.0] };
        let posterior = ComponentPosterior::new(&Hyper::paper(100, 100.0), DVec3::ZERO, &moments);
        let of = ComponentAttributes::new(&posterior, &normalization, Some(-3.0), Some(7));
        let covariance = posterior.expected_covariance().to_array();
        let by_hand = (100.0 * covariance[0] + 4.0 * (covariance[3] + covariance[5])) / 4.001;
        assert!((f64::from(of.uncertainty.unwrap()) - by_hand.sqrt()).abs() < 1e-6);
        assert_eq!((of.evidence, of.elbo, of.birth), (Some(4.0), Some(-3.0), Some(7)));
        let unused =
            ComponentPosterior::new(&Hyper::paper(100, 100.0), DVec3::ZERO, &Moments::default());
        assert_eq!(
            ComponentAttributes::new(&unused, &normalization, None, None),
            ComponentAttributes::default()
        );
    }
}
