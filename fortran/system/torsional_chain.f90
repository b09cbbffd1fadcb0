!> Both wheels as bodies of their own: two degrees of freedom, n bodies being two here.
!>
!>     J1 theta1'' = T_m - N        J2 theta2'' = i12 N - T_l        N: torque of the mesh on J1
!>
!> With M = i12**2 J1 + J2 the coordinates are the relative angle theta = theta1 - i12 theta2 and
!> the mean one, Theta = (i12 J1 theta1 + J2 theta2)/M, both as deviations from the nominal
!> rotation. N presses both bodies apart and cancels from the mean:
!>
!>     theta'' = F - N/J            Theta'' = (i12 T_m - T_l)/M
!>     theta1 = i12 Theta + (J2/M) theta        theta2 = Theta - (i12 J1/M) theta
!>
!> The first is the oscillator; this type adds the second. An impact is an impulse I on J1 and i12 I
!> on J2: with I = -J (theta'+ - theta'-) it fulfils any law for theta' exactly and leaves Theta'
!> alone. Derivation: docs/model.md.
!>
!> y = (distance and velocity relative to the flank last touched, Theta, Theta'). The angles of the
!> bodies themselves grow with the rotation; F would be lost in their last digits.
module lapwing_system_torsional_chain
  use lapwing_kinds, only: wp
  use lapwing_system_oscillator, only: oscillator_t, make_oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_system_spring_stages, only: flight_stages
  use lapwing_system, only: instant_t, frame_t, motion_t, max_states
  use lapwing_system_step, only: step_t, lengths_t
  implicit none
  private
  public :: torsional_chain_t, make_torsional_chain

  type, extends(oscillator_t) :: torsional_chain_t
    real(wp) :: mean_acceleration = 0     !! Theta'', rad per tau**2
  contains
    procedure :: change_force, derivatives, stages, stay, commit, scales
  end type torsional_chain_t

contains

  !> Chain from its parameters and its transmission error over mesh phase, see `make_oscillator`.
  subroutine make_torsional_chain(parameters, knots, coefficients, kinks, series, self, error)
    type(parameters_t), intent(in) :: parameters  !! dimensionless parameters
    real(wp), intent(in) :: knots(:)              !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: coefficients(0:, :)   !! (0:5, n) rad per mesh period**k
    logical, intent(in) :: kinks(:)               !! (n) slope jump at knots(i)
    real(wp), intent(in) :: series(:, :)          !! (3, terms), first order -1: none
    type(torsional_chain_t), intent(out) :: self  !! chain
    integer, intent(out) :: error                 !! 0, or there is no memory for it
    call make_oscillator(parameters, knots, coefficients, kinks, series, self%oscillator_t, error)
    self%n_states = 4
    self%mean_acceleration = parameters%mean_acceleration
  end subroutine make_torsional_chain

  !> The same chain under other torques.
  pure subroutine change_force(self, parameters)
    class(torsional_chain_t), intent(inout) :: self
    type(parameters_t), intent(in) :: parameters   !! dimensionless parameters
    call self%oscillator_t%change_force(parameters)
    self%mean_acceleration = parameters%mean_acceleration
  end subroutine change_force

  !> The relative motion, and the mean one under the torques from outside.
  pure subroutine derivatives(self, frame, motion_state, s, z, rate)
    class(torsional_chain_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(in) :: z(:)                 !! relative, mean: position and velocity
    real(wp), intent(out) :: rate(:)             !! velocity and acceleration
    call self%oscillator_t%derivatives(frame, motion_state, s, z(:2), rate(:2))
    rate(3:4) = [z(4), self%mean_acceleration]
  end subroutine derivatives

  !> The stages of both, written out: the formula is exact for the mean motion.
  subroutine stages(self, frame, motion_state, h, z, lengths, step, done)
    class(torsional_chain_t), intent(in) :: self
    type(frame_t), intent(in) :: frame             !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h                      !! step
    real(wp), intent(in) :: z(max_states)          !! local coordinates at s = 0
    type(lengths_t), intent(inout), optional :: lengths   !! what steps of one length share;
                                                          !! absent: it will not come again
    type(step_t), intent(inout) :: step            !! the result
    logical, intent(out) :: done                   !! always
    type(step_t) :: mean
    call self%oscillator_t%stages(frame, motion_state, h, z, lengths, step, done)
    call flight_stages(self%mean_acceleration, h, z(3:4), mean)
    step%middle(3:4) = mean%middle(:2)
    step%end(3:4) = mean%end(:2)
    step%correction(3:4) = 0
    step%rate_begin(3:4) = mean%rate_begin(:2)
    step%rate_middle(3:4) = mean%rate_middle(:2)
    step%rate_end(3:4) = mean%rate_end(:2)
  end subroutine stages

  !> A step in contact that certainly stays inside the flank, to its end.
  pure subroutine stay(self, frame, begin, motion, z_end, y, stays)
    class(torsional_chain_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    type(instant_t), intent(in) :: begin         !! where the step begins
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: z_end(max_states)    !! local coordinates at its end
    real(wp), intent(inout) :: y(max_states)     !! if it stays: state variables there
    logical, intent(out) :: stays                !! whether it does
    call self%oscillator_t%stay(frame, begin, motion, z_end, y, stays)
    if (stays) y(3:4) = z_end(3:4)
  end subroutine stay

  !> The relative motion as seen from a flank; the mean one has no frame.
  pure subroutine commit(self, frame, s, z, chart, y)
    class(torsional_chain_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(in) :: z(max_states)        !! local coordinates
    integer, intent(in) :: chart                 !! flank to refer to
    real(wp), intent(out) :: y(max_states)       !! state variables
    call self%oscillator_t%commit(frame, s, z, chart, y)
    y(3:4) = z(3:4)
  end subroutine commit

  !> No step is too long for the mean motion, however far it has gone.
  pure subroutine scales(self, motion_state, scale)
    class(torsional_chain_t), intent(in) :: self
    integer, intent(in) :: motion_state
    real(wp), intent(out) :: scale(max_states)   !! sizes
    call self%oscillator_t%scales(motion_state, scale)
    scale(3:4) = huge(scale)
  end subroutine scales
end module lapwing_system_torsional_chain
