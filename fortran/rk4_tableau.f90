!> Coefficients of the fourth-order Runge-Kutta formula and of its dense output.
!>
!> Owren and Zennaro, "Derivation of efficient, continuous, explicit Runge-Kutta methods",
!> SIAM J. Sci. Stat. Comput. 13 (1992) 1488-1501: six stages, the last at the end of the step;
!> the dense output needs no further stage and is of fourth order over the whole step.
module lapwing_rk4_tableau
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: n_stages, order, c2, c3, c4, c5
  public :: a21, a31, a32, a41, a42, a43, a51, a52, a53, a54, b1, b3, b4, b5, dense_weight

  integer, parameter :: n_stages = 6
  integer, parameter :: order = 4

  real(wp), parameter :: c2 = 1.0_wp/6, c3 = 11.0_wp/37, c4 = 11.0_wp/17, c5 = 13.0_wp/15
  real(wp), parameter :: a21 = 1.0_wp/6
  real(wp), parameter :: a31 = 44.0_wp/1369, a32 = 363.0_wp/1369
  real(wp), parameter :: a41 = 3388.0_wp/4913, a42 = -8349.0_wp/4913, a43 = 8140.0_wp/4913
  real(wp), parameter :: a51 = -36764.0_wp/408375, a52 = 767.0_wp/1125
  real(wp), parameter :: a53 = -32708.0_wp/136125, a54 = 210392.0_wp/408375
  real(wp), parameter :: b1 = 1697.0_wp/18876, b3 = 50653.0_wp/116160
  real(wp), parameter :: b4 = 299693.0_wp/1626240, b5 = 3375.0_wp/11648

  !> Weight of stage i in the coefficient of (s/h)**k, k = 2, 3, 4. The first stage alone makes
  !> k = 1, the second stage enters nowhere.
  real(wp), parameter :: dense_weight(n_stages, 2:4) = reshape([ &
      -104217.0_wp/37466, 0.0_wp, 861101.0_wp/230560, -63869.0_wp/293440, &
      -1522125.0_wp/762944, 165.0_wp/131, &
      1806901.0_wp/618189, 0.0_wp, -2178079.0_wp/380424, 6244423.0_wp/5325936, &
      982125.0_wp/190736, -461.0_wp/131, &
      -866577.0_wp/824252, 0.0_wp, 12308679.0_wp/5072320, -7816583.0_wp/10144640, &
      -624375.0_wp/217984, 296.0_wp/131], [n_stages, 3])
end module lapwing_rk4_tableau
