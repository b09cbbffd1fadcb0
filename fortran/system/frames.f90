!> The Galilean frame of one step: opened, moved on piece by piece, and where the flank of its chart
!> is at any time of the step. It is moved on where all flanks go together.
module lapwing_system_frames
  use lapwing_kinds, only: wp
  use lapwing_codes, only: drive_flank, coast_flank
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, value_and_slope, &
      taylor_shift
  use lapwing_system, only: instant_t, frame_t, motion_t, dense_degree
  use lapwing_flank, only: flank_t, piece_at
  use lapwing_flank_fixed, only: fixed_flank_t
  implicit none
  private
  public :: open_on_piece, open_unseen, open_with_flanks, carry_over, distance_in_frame, move_to
  public :: flank_in_frame, flank_over_step

  !> Over so many pieces a frame is moved one by one, which keeps the relative precision of a small
  !> bounce across a knot. One that takes longer is larger than the rounding of the table. One knot
  !> is what it takes; with 2 and 8 random scenes have the same events.
  integer, parameter :: few_pieces = 4

contains

  !> Where a frame lies: a piece of the flanks' motion, up to the next kink or the end of the cycle.
  pure subroutine open_on_piece(path, piece, instant, frame)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    integer, intent(in) :: piece                 !! piece that holds the instant
    type(instant_t), intent(in) :: instant       !! where it opens
    type(frame_t), intent(inout) :: frame        !! its frame
    frame%chart = instant%chart
    frame%t = instant%t
    frame%piece = piece
    frame%piece_begin = 0
    frame%piece_end = path%knot(piece + 1) - instant%t
    frame%stop_knot = path%next_kink(piece)
    frame%stop = path%knot(frame%stop_knot) - instant%t
  end subroutine open_on_piece

  !> A frame and its flanks: moving together, or one of them standing still.
  pure subroutine open_with_flanks(path, fixed, width, instant, frame)
    class(flank_t), intent(in) :: path           !! motion of the drive flank
    type(fixed_flank_t), allocatable, intent(in) :: fixed   !! the coast flank, where it has its own
    real(wp), intent(in) :: width                !! distance between them, rad
    type(instant_t), intent(in) :: instant       !! where it opens
    type(frame_t), intent(inout) :: frame        !! its frame
    real(wp) :: g(0:max_degree), still(0:max_degree)
    call open_on_piece(path, piece_at(path, instant%t), instant, frame)
    if (allocated(fixed)) then
      call path%taylor(frame%piece, instant%t, g)
      call fixed%taylor(1, instant%t, still)
      call set_apart(g, still, width, frame)
    else
      call set_together(path, width, frame)
    end if
  end subroutine open_with_flanks

  !> Where a frame lies whose flanks nobody asks for: up to the end of the cycle.
  pure subroutine open_unseen(path, instant, frame)
    class(flank_t), intent(in) :: path           !! motion of the flanks, without kinks
    type(instant_t), intent(in) :: instant       !! where it opens
    type(frame_t), intent(inout) :: frame        !! its frame
    frame%chart = instant%chart
    frame%t = instant%t
    frame%piece = 0
    frame%stop_knot = path%n + 1
    frame%stop = path%knot(path%n + 1) - instant%t
  end subroutine open_unseen

  !> Both flanks, which move together, in a frame that goes with them.
  pure subroutine set_together(path, width, frame)
    class(flank_t), intent(in) :: path               !! their motion
    real(wp), intent(in) :: width                    !! distance between them, rad
    type(frame_t), intent(inout) :: frame
    ! Into its place, not by way of another array: what is just stored is slow to copy.
    call path%taylor(frame%piece, frame%t, frame%flank(:, frame%chart))
    frame%origin = frame%flank(0, frame%chart)
    frame%origin_rate = frame%flank(1, frame%chart)
    frame%flank(0:1, frame%chart) = 0
    call set_other_flank(width, frame)
  end subroutine set_together

  !> The same of flanks with motions of their own, in a frame that goes with that of its chart.
  pure subroutine set_apart(drive, coast, width, frame)
    real(wp), intent(in) :: drive(0:max_degree)      !! motion of the drive flank
    real(wp), intent(in) :: coast(0:max_degree)      !! and of the coast flank
    real(wp), intent(in) :: width                    !! distance between them, rad
    type(frame_t), intent(inout) :: frame
    frame%flank(:, drive_flank) = drive
    frame%flank(:, coast_flank) = coast
    frame%origin = frame%flank(0, frame%chart)
    frame%origin_rate = frame%flank(1, frame%chart)
    frame%flank(0, :) = frame%flank(0, :) - frame%origin
    frame%flank(1, :) = frame%flank(1, :) - frame%origin_rate
    if (frame%chart == drive_flank) then
      frame%flank(0, coast_flank) = frame%flank(0, coast_flank) - width
    else
      frame%flank(0, drive_flank) = frame%flank(0, drive_flank) + width
    end if
  end subroutine set_apart

  !> Move a frame on to the piece that holds s, not beyond the last before the stop.
  pure subroutine move_to(path, width, s, frame)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    real(wp), intent(in) :: s                    !! time since the frame was opened
    type(frame_t), intent(inout) :: frame        !! frame, moved on
    integer :: piece
    if (s <= frame%piece_end) return
    piece = min(piece_at(path, frame%t + s), frame%stop_knot - 1)
    if (piece - frame%piece <= few_pieces) then
      do while (frame%piece < piece)
        call go_on(path, width, frame)
      end do
      return
    end if
    frame%piece = piece
    frame%piece_begin = path%knot(piece) - frame%t
    frame%piece_end = path%knot(piece + 1) - frame%t
    associate (g => frame%flank, own => frame%chart)
      call path%taylor(piece, path%knot(piece), g(:, own))
      g(0, own) = g(0, own) - frame%origin - frame%origin_rate*frame%piece_begin
      g(1, own) = g(1, own) - frame%origin_rate
    end associate
    call set_other_flank(width, frame)
  end subroutine move_to

  !> Move a frame on to the next piece, flanks each by their own motion: position and velocity are
  !> carried over, the next piece's bend takes over.
  pure subroutine carry_over(path, moves, frame)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    logical, intent(in) :: moves(2)              !! which of them move with it
    type(frame_t), intent(inout) :: frame        !! frame, moved one piece on
    real(wp) :: span, position, slope, g(0:max_degree)
    integer :: flank
    span = frame%piece_end - frame%piece_begin
    frame%piece = frame%piece + 1
    frame%piece_begin = frame%piece_end
    frame%piece_end = path%knot(frame%piece + 1) - frame%t
    call path%taylor(frame%piece, path%knot(frame%piece), g)
    do flank = 1, 2
      position = horner(frame%flank(:, flank), span)
      slope = horner_slope(frame%flank(:, flank), span)
      if (moves(flank)) then
        ! Off kinks the jump is rounding, but left out it would add up to a mean force.
        slope = slope + path%slope_jump(frame%piece)
        frame%flank(2:, flank) = g(2:)
      end if
      frame%flank(0:1, flank) = [position, slope]
    end do
  end subroutine carry_over

  !> Move a frame on to the next piece.
  pure subroutine go_on(path, width, frame)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    type(frame_t), intent(inout) :: frame        !! frame, moved one piece on
    frame%flank(:, frame%chart) = on_next_piece(path, frame)
    frame%piece = frame%piece + 1
    frame%piece_begin = frame%piece_end
    frame%piece_end = path%knot(frame%piece + 1) - frame%t
    call set_other_flank(width, frame)
  end subroutine go_on

  !> The other flank, which moves together with that of the chart.
  pure subroutine set_other_flank(width, frame)
    real(wp), intent(in) :: width                !! distance between them, rad
    type(frame_t), intent(inout) :: frame
    integer :: other
    other = drive_flank + coast_flank - frame%chart
    frame%flank(:, other) = frame%flank(:, frame%chart)
    frame%flank(0, other) = frame%flank(0, frame%chart) + merge(width, -width, other == drive_flank)
  end subroutine set_other_flank

  !> Position and velocity, in the frame, of the flank of its chart. Up to the second knot nothing
  !> is lost against the flank's own motion since the frame was opened; a step that goes farther is
  !> larger than the rounding of the table.
  pure subroutine flank_in_frame(path, frame, s, position, slope)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    type(frame_t), intent(in) :: frame           !! frame as opened
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(out) :: position, slope     !! in the frame
    real(wp) :: g(0:max_degree)
    integer :: piece
    if (s <= frame%piece_end) then
      call value_and_slope(frame%flank(:, frame%chart), s, position, slope)
    else if (s <= second_end(path, frame)) then
      call value_and_slope(on_next_piece(path, frame), s - frame%piece_end, position, slope)
    else
      piece = min(piece_at(path, frame%t + s), frame%stop_knot - 1)
      call path%taylor(piece, path%knot(piece), g)
      call value_and_slope(g, (frame%t + s) - path%knot(piece), position, slope)
      position = (position - frame%origin) - frame%origin_rate*s
      slope = slope - frame%origin_rate
    end if
  end subroutine flank_in_frame

  !> Where the piece after a frame's own ends, or its own if the step must end there.
  pure real(wp) function second_end(path, frame)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    type(frame_t), intent(in) :: frame           !! frame as opened
    second_end = path%knot(min(frame%piece + 2, frame%stop_knot)) - frame%t
  end function second_end

  !> The flank of a frame's chart on the piece after the frame's own, about the knot between them.
  pure function on_next_piece(path, frame) result(g)
    class(flank_t), intent(in) :: path           !! motion of the flanks
    type(frame_t), intent(in) :: frame
    real(wp) :: g(0:max_degree)
    real(wp) :: position, slope
    call value_and_slope(frame%flank(:, frame%chart), frame%piece_end - frame%piece_begin, &
        position, slope)
    call path%taylor(frame%piece + 1, path%knot(frame%piece + 1), g)
    ! Off kinks the jump is rounding, but left out it would add up to a mean force.
    g(0:1) = [position, slope + path%slope_jump(frame%piece + 1)]
  end function on_next_piece

  !> The flank at the quarters of a step, at its end to the same bit as asked for alone.
  pure subroutine flank_over_step(path, frame, h, position, slope)
    class(flank_t), intent(in) :: path                     !! motion of the flanks
    type(frame_t), intent(in) :: frame                     !! frame as opened
    real(wp), intent(in) :: h                              !! step
    real(wp), intent(out) :: position(4), slope(4)         !! at its quarters, in the frame
    real(wp) :: s(4), g(0:max_degree)
    integer :: i, piece
    s = [1, 2, 3, 4]*(0.25_wp*h)
    if (h <= frame%piece_end) then
      associate (c => frame%flank(:, frame%chart))
        position = c(max_degree + 1)
        slope = 0
        do i = max_degree, 1, -1
          slope = slope*s + position
          position = position*s + c(i)
        end do
      end associate
    else if (h <= second_end(path, frame)) then
      g = on_next_piece(path, frame)
      do i = 1, 4
        if (s(i) <= frame%piece_end) then
          call value_and_slope(frame%flank(:, frame%chart), s(i), position(i), slope(i))
        else
          call value_and_slope(g, s(i) - frame%piece_end, position(i), slope(i))
        end if
      end do
    else
      do i = 1, 4
        piece = min(piece_at(path, frame%t + s(i)), frame%stop_knot - 1)
        call path%taylor(piece, path%knot(piece), g)
        call value_and_slope(g, (frame%t + s(i)) - path%knot(piece), position(i), slope(i))
      end do
      position = (position - frame%origin) - frame%origin_rate*s
      slope = slope - frame%origin_rate
    end if
  end subroutine flank_over_step

  !> Distance to a flank over a frame's piece, about its beginning.
  pure subroutine distance_in_frame(frame, flank, motion, c)
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank                           !! drive_flank or coast_flank
    type(motion_t), intent(in) :: motion                   !! step as a polynomial
    real(wp), intent(out) :: c(0:max_degree)               !! coefficients in s - piece_begin
    real(wp) :: position(0:dense_degree), inverse, power
    integer :: k
    inverse = 1/motion%h
    power = 1
    do k = 0, dense_degree
      position(k) = motion%dense(k, 1)*power
      power = power*inverse
    end do
    if (frame%piece_begin > 0) call taylor_shift(position, frame%piece_begin)
    c = frame%flank(:, flank) - position
    if (flank == coast_flank) c = -c
  end subroutine distance_in_frame
end module lapwing_system_frames
