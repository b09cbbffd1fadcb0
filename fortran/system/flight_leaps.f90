!> A flight over pieces of a table on which it certainly meets no flank, all flanks moving alike.
module lapwing_system_flight_leaps
  use lapwing_kinds, only: wp
  use lapwing_system_clearance, only: no_sooner
  use lapwing_codes, only: drive_flank, coast_flank
  use lapwing_system_frames, only: move_to
  use lapwing_polynomial_evaluation, only: horner, value_and_slope
  use lapwing_system, only: frame_t, motion_t
  use lapwing_flank_table, only: te_table_t
  implicit none
  private
  public :: leap_over_pieces

contains

  !> Up to the piece on which a flank might be met. Each time of grace that does not end on the
  !> piece where it began leads to a later one.
  pure subroutine leap_over_pieces(table, width, n_flanks, force, motion, frame, touching, clear)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    integer, intent(in) :: n_flanks              !! 2, or 1 without a coast flank
    real(wp), intent(in) :: force                !! acceleration of the flight
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    type(frame_t), intent(inout) :: frame        !! frame, on the piece to be searched next
    integer, intent(inout) :: touching           !! flank at zero distance where it begins, or none
    logical, intent(out) :: clear                !! whether nothing is met up to the step's end
    real(wp) :: s
    s = frame%piece_begin
    do
      s = s + time_of_grace(table, width, n_flanks, force, frame, touching, motion, s)
      clear = s >= motion%h
      if (.not. clear .and. s <= frame%piece_end) return
      call move_to(table, width, min(s, motion%h), frame)
      if (clear) return
      touching = 0
    end do
  end subroutine leap_over_pieces

  !> Time for which a flight, at s of a step, can meet no flank: the distance begins with the value
  !> and slope it has there and bends towards the flank as much as it can anywhere.
  pure real(wp) function time_of_grace(table, width, n_flanks, force, frame, touching, motion, s)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    integer, intent(in) :: n_flanks              !! 2, or 1 without a coast flank
    real(wp), intent(in) :: force                !! acceleration of the flight
    type(frame_t), intent(in) :: frame           !! frame, on the piece that holds s
    integer, intent(in) :: touching              !! flank at zero distance there, or none
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), parameter :: caution = 1 - 2.0_wp**(-20)   !! far more than the rounding of a root
    real(wp) :: position, slope, above, below, approach
    call value_and_slope(frame%flank(:, frame%chart), s - frame%piece_begin, position, slope)
    ! Distances to the coast flank, and to the drive flank.
    below = horner(motion%dense(:, 1), s/motion%h) - position
    approach = horner(motion%dense(:, 2), s/motion%h) - slope
    if (frame%chart == drive_flank) then
      above = -below
      below = below + width
    else
      above = width - below
    end if
    if (touching == drive_flank) above = 0
    if (touching == coast_flank) below = 0
    time_of_grace = no_sooner(above, approach, force + table%push(coast_flank))
    if (n_flanks == 2) then
      time_of_grace = min(time_of_grace, no_sooner(below, -approach, &
          table%push(drive_flank) - force))
    end if
    time_of_grace = caution*time_of_grace
  end function time_of_grace
end module lapwing_system_flight_leaps
