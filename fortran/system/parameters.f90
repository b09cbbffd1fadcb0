!> What defines an oscillator but its table, and the sizes that follow from it.
module lapwing_system_parameters
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: parameters_t, natural_angle, felt_jump

  !> Everything dimensionless that defines an oscillator but its table.
  type :: parameters_t
    real(wp) :: force = 1                 !! F, rad
    real(wp) :: mesh_frequency_ratio = 1  !! Omega
    real(wp) :: flank_scale = 1           !! g / transmission error, +i12 or -i12
    real(wp) :: peak_to_peak = 0          !! of g, rad
    real(wp) :: damping_ratio = 0         !! xi
    real(wp) :: restitution = 1           !! epsilon
    real(wp) :: backlash = 1              !! theta0, rad
    real(wp) :: tolerance = 1.0e-10_wp    !! relative; decides which curvature jumps are felt
    real(wp) :: mean_acceleration = 0     !! of the mean rotation, rad per tau**2
    integer :: curve = 1                  !! which of the transmission errors, where there are some
    integer :: degrees_of_freedom = 1     !! 2: the mean rotation is a coordinate too
    integer :: contact_law = 1            !! law_*
    integer :: impact_law = 1             !! law_*
    integer :: gap = 1                    !! gap_*
    logical :: back_flank_te = .true.     !! whether the coast flank moves with g
  end type parameters_t

contains

  !> Natural size of angles, rad.
  pure real(wp) function natural_angle(p)
    type(parameters_t), intent(in) :: p      !! dimensionless parameters
    natural_angle = min(p%backlash, max(abs(p%force), p%peak_to_peak))
    if (natural_angle <= 0) natural_angle = p%backlash
  end function natural_angle

  !> Smallest curvature jump of g that a step in contact may not cross, rad per tau**2.
  !>
  !> A jump D of g'' bends the contact acceleration by 2 xi D s + D s**2/2; over a step of unit
  !> length (a sixth of the natural period, longer ones are not accurate) that is a velocity of
  !> D (xi + 1/6) which no fourth-order step sees. Felt is what exceeds the tolerance.
  pure real(wp) function felt_jump(p)
    type(parameters_t), intent(in) :: p      !! dimensionless parameters
    felt_jump = p%tolerance*natural_angle(p)/(p%damping_ratio + 1.0_wp/6)
  end function felt_jump
end module lapwing_system_parameters
