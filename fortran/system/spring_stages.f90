!> The stages of a step written out for the gear's two equations of motion: what flow/rk4/step.f90
!> does with their derivatives, to rounding, at a fifth of its price.
module lapwing_system_spring_stages
  use lapwing_kinds, only: wp
  use lapwing_flank, only: flank_t
  use lapwing_system, only: frame_t
  use lapwing_system_frames, only: flank_in_frame, flank_over_step
  use lapwing_system_step, only: step_t, richardson, sixth, change
  implicit none
  private
  public :: drive, drive_over_step, spring_stages, flight_stages

contains

  !> What drives the damped spring in contact, at s: the force, and the flank's motion in the frame.
  pure real(wp) function drive(flank, force, damping, moves, frame, s)
    class(flank_t), intent(in) :: flank      !! motion of the flanks
    real(wp), intent(in) :: force            !! F
    real(wp), intent(in) :: damping          !! 2 xi
    logical, intent(in) :: moves             !! whether the flank of the frame's chart does
    type(frame_t), intent(in) :: frame       !! frame as opened
    real(wp), intent(in) :: s                !! time since the frame was opened
    real(wp) :: position, slope
    drive = force
    if (s <= 0 .or. .not. moves) return
    call flank_in_frame(flank, frame, s, position, slope)
    drive = force + (position + damping*slope)
  end function drive

  !> The same at the quarters of a step, and where the flank is at its end.
  pure subroutine drive_over_step(flank, force, damping, moves, frame, h, driven, landing)
    class(flank_t), intent(in) :: flank      !! motion of the flanks
    real(wp), intent(in) :: force            !! F
    real(wp), intent(in) :: damping          !! 2 xi
    logical, intent(in) :: moves             !! whether the flank of the frame's chart does
    type(frame_t), intent(in) :: frame       !! frame as opened
    real(wp), intent(in) :: h                !! step
    real(wp), intent(out) :: driven(4)       !! at its quarters
    real(wp), intent(out) :: landing(2)      !! flank's position and velocity at s = h
    real(wp) :: position(4), slope(4)
    driven = force
    landing = 0
    if (.not. moves) return
    call flank_over_step(flank, frame, h, position, slope)
    driven = force + (position + damping*slope)
    landing = [position(4), slope(4)]
  end subroutine drive_over_step

  !> Two classical steps of the damped spring and one over both, extrapolated: `doubled_step`
  !> of flow/rk4/step.f90 line by line.
  pure subroutine spring_stages(damping, force, driven, h, z, step)
    real(wp), intent(in) :: damping          !! 2 xi
    real(wp), intent(in) :: force            !! what drives it at s = 0
    real(wp), intent(in) :: driven(4)        !! and at the quarters of the step
    real(wp), intent(in) :: h                !! step
    real(wp), intent(in) :: z(2)             !! position and velocity at s = 0
    type(step_t), intent(inout) :: step      !! the result
    real(wp), dimension(2) :: middle, fine, coarse
    real(wp) :: begin, turn
    begin = (force - z(1)) - damping*z(2)
    call spring_step(damping, driven(1), driven(2), 0.5_wp*h, z, begin, middle)
    call spring_step(damping, driven(2), driven(4), h, z, begin, coarse)
    turn = (driven(2) - middle(1)) - damping*middle(2)
    call spring_step(damping, driven(3), driven(4), 0.5_wp*h, middle, turn, fine)
    step%correction(1:2) = richardson*(fine - coarse)
    step%middle(1:2) = middle + 0.5_wp*step%correction(1:2)
    step%end(1:2) = fine + step%correction(1:2)
    step%rate_begin(1:2) = [z(2), begin]
    step%rate_middle(1:2) = [middle(2), turn]
    step%rate_end(1:2) = [step%end(2), (driven(4) - step%end(1)) - damping*step%end(2)]
  end subroutine spring_stages

  !> One classical step of x'' = D(s) - x - 2 xi x'. Of the four pairs of rates (k_i, a_i) each
  !> velocity is known from the accelerations before it, k2 = z2 + h/2 a1, k3 = z2 + h/2 a2,
  !> k4 = z2 + h a3; what is left are the four accelerations. Each waits for the one before by a
  !> product and a difference only: stages are most of what a step takes.
  pure subroutine spring_step(damping, half_way, at_end, h, z, a1, z_end)
    real(wp), intent(in) :: damping              !! 2 xi
    real(wp), intent(in) :: half_way, at_end     !! D at h/2 and h
    real(wp), intent(in) :: h                    !! step
    real(wp), intent(in) :: z(2)                 !! position and velocity at s = 0
    real(wp), intent(in) :: a1                   !! acceleration there
    real(wp), intent(out) :: z_end(2)            !! position and velocity at s = h
    real(wp) :: half, rest, a2, a3, a4
    half = 0.5_wp*h
    rest = (half_way - damping*z(2)) - (z(1) + half*z(2))
    a2 = rest - (damping*half)*a1
    a3 = (rest - half**2*a1) - (damping*half)*a2
    rest = (at_end - damping*z(2)) - (z(1) + h*z(2))
    a4 = (rest - (h*half)*a2) - (damping*h)*a3
    z_end(1) = z(1) + (h*(z(2) + half*a1) + (h**2*sixth)*((a2 - a1) + (a3 - a1)))
    z_end(2) = z(2) + change(h, a1, a2, a3, a4)
  end subroutine spring_step

  !> What the stages give under a constant force, where the formula is exact.
  pure subroutine flight_stages(force, h, z, step)
    real(wp), intent(in) :: force            !! theta''
    real(wp), intent(in) :: h                !! step
    real(wp), intent(in) :: z(:)             !! position and velocity at s = 0
    type(step_t), intent(inout) :: step      !! the result
    real(wp) :: half
    half = 0.5_wp*h
    step%middle(1) = z(1) + half*(z(2) + 0.5_wp*half*force)
    step%middle(2) = z(2) + half*force
    step%end(1) = z(1) + h*(z(2) + half*force)
    step%end(2) = z(2) + h*force
    step%correction(1:2) = 0
    step%rate_begin(1:2) = [z(2), force]
    step%rate_middle(1:2) = [step%middle(2), force]
    step%rate_end(1:2) = [step%end(2), force]
  end subroutine flight_stages
end module lapwing_system_spring_stages
