!> The Galilean frame of one step where every flank there is moves with the table: opened, moved on
!> piece by piece, and where the flank of its chart is at any time of the step.
module lapwing_system_frames
  use lapwing_kinds, only: wp
  use lapwing_codes, only: drive_flank, coast_flank
  use lapwing_polynomial_evaluation, only: max_degree, value_and_slope, taylor_shift
  use lapwing_system, only: instant_t, frame_t, motion_t, dense_degree
  use lapwing_flank_table, only: te_table_t, piece_at, expand_at
  implicit none
  private
  public :: open_on_piece, open_in_contact, distance_in_frame
  public :: frame_about, move_to, flank_in_frame, flank_over_step

  !> Over so many pieces a frame is moved one by one, which keeps the relative precision of a small
  !> bounce across a knot. One that takes longer is larger than the rounding of the table.
  integer, parameter :: few_pieces = 4

contains

  !> Where a frame lies: a piece of the table, up to the next kink or the end of the cycle.
  pure subroutine open_on_piece(table, piece, instant, frame)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    integer, intent(in) :: piece                 !! piece that holds the instant
    type(instant_t), intent(in) :: instant       !! where it opens
    type(frame_t), intent(inout) :: frame        !! its frame
    frame%chart = instant%chart
    frame%t = instant%t
    frame%piece = piece
    frame%piece_begin = 0
    frame%piece_end = table%knot(piece + 1) - instant%t
    frame%stop_knot = table%next_kink(piece)
    frame%stop = table%knot(frame%stop_knot) - instant%t
  end subroutine open_on_piece

  !> The frame of a step in contact: what `frame_about` makes of it, with nothing left to decide.
  pure subroutine open_in_contact(table, width, instant, frame)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    type(instant_t), intent(in) :: instant       !! where the step begins
    type(frame_t), intent(inout) :: frame        !! its frame
    real(wp) :: g(0:max_degree)
    call open_on_piece(table, piece_at(table, instant%t), instant, frame)
    call expand_at(table, frame%piece, instant%t, g)
    frame%origin = g(0)
    frame%origin_rate = g(1)
    g(0:1) = 0
    call set_flanks(g, width, frame)
  end subroutine open_in_contact

  !> Flanks in a frame, moving alike or the coast flank not at all, from the Taylor coefficients of
  !> g where the step begins.
  pure subroutine frame_about(taylor, width, coast_moves, frame)
    real(wp), intent(in) :: taylor(0:max_degree)     !! of g there
    real(wp), intent(in) :: width                    !! distance between the flanks, rad
    logical, intent(in) :: coast_moves               !! whether the coast flank moves with g
    type(frame_t), intent(inout) :: frame            !! its frame
    real(wp) :: g(0:max_degree)
    g = taylor
    frame%origin = g(0)
    frame%origin_rate = 0
    if (frame%chart == drive_flank .or. coast_moves) then
      frame%origin_rate = g(1)
      g(0:1) = 0
    end if
    frame%flank(:, drive_flank) = g
    if (coast_moves) then
      frame%flank(:, coast_flank) = g
    else
      frame%flank(:, coast_flank) = 0
      if (frame%chart == drive_flank) frame%flank(0:1, coast_flank) = &
          [-frame%origin, -frame%origin_rate]
    end if
    if (frame%chart == drive_flank) then
      frame%flank(0, coast_flank) = frame%flank(0, coast_flank) - width
    else
      frame%flank(0, drive_flank) = frame%flank(0, drive_flank) + width
    end if
  end subroutine frame_about

  !> Move a frame on to the piece that holds s, not beyond the last before the stop.
  pure subroutine move_to(table, width, s, frame)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    real(wp), intent(in) :: s                    !! time since the frame was opened
    type(frame_t), intent(inout) :: frame        !! frame, moved on
    real(wp) :: g(0:max_degree)
    integer :: piece
    if (s <= frame%piece_end) return
    piece = min(piece_at(table, frame%t + s), frame%stop_knot - 1)
    if (piece - frame%piece <= few_pieces) then
      do while (frame%piece < piece)
        call go_on(table, width, frame)
      end do
      return
    end if
    frame%piece = piece
    frame%piece_begin = table%knot(piece) - frame%t
    frame%piece_end = table%knot(piece + 1) - frame%t
    g = table%coefficient(:, piece)
    g(0) = g(0) - frame%origin - frame%origin_rate*frame%piece_begin
    g(1) = g(1) - frame%origin_rate
    call set_flanks(g, width, frame)
  end subroutine move_to

  !> Move a frame on to the next piece.
  pure subroutine go_on(table, width, frame)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    type(frame_t), intent(inout) :: frame        !! frame, moved one piece on
    real(wp) :: g(0:max_degree)
    g = on_next_piece(table, frame)
    frame%piece = frame%piece + 1
    frame%piece_begin = frame%piece_end
    frame%piece_end = table%knot(frame%piece + 1) - frame%t
    call set_flanks(g, width, frame)
  end subroutine go_on

  !> Both flanks, from the polynomial of the chart's own.
  pure subroutine set_flanks(g, width, frame)
    real(wp), intent(in) :: g(0:max_degree)      !! flank of the chart
    real(wp), intent(in) :: width                !! distance between the flanks, rad
    type(frame_t), intent(inout) :: frame        !! frame
    frame%flank(:, drive_flank) = g
    frame%flank(:, coast_flank) = g
    if (frame%chart == drive_flank) then
      frame%flank(0, coast_flank) = g(0) - width
    else
      frame%flank(0, drive_flank) = g(0) + width
    end if
  end subroutine set_flanks

  !> Position and velocity, in the frame, of the flank of its chart. Up to the second knot nothing
  !> is lost against the flank's own motion since the frame was opened; a step that goes farther is
  !> larger than the rounding of the table.
  pure subroutine flank_in_frame(table, frame, s, position, slope)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    type(frame_t), intent(in) :: frame           !! frame as opened
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(out) :: position, slope     !! in the frame
    integer :: piece
    if (s <= frame%piece_end) then
      call value_and_slope(frame%flank(:, frame%chart), s, position, slope)
    else if (s <= second_end(table, frame)) then
      call value_and_slope(on_next_piece(table, frame), s - frame%piece_end, position, slope)
    else
      piece = min(piece_at(table, frame%t + s), frame%stop_knot - 1)
      call value_and_slope(table%coefficient(:, piece), (frame%t + s) - table%knot(piece), &
          position, slope)
      position = (position - frame%origin) - frame%origin_rate*s
      slope = slope - frame%origin_rate
    end if
  end subroutine flank_in_frame

  !> Where the piece after a frame's own ends, or its own if the step must end there.
  pure real(wp) function second_end(table, frame)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    type(frame_t), intent(in) :: frame           !! frame as opened
    second_end = table%knot(min(frame%piece + 2, frame%stop_knot)) - frame%t
  end function second_end

  !> The flank of a frame's chart on the piece after the frame's own, about the knot between them.
  pure function on_next_piece(table, frame) result(g)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    type(frame_t), intent(in) :: frame           !! frame
    real(wp) :: g(0:max_degree)
    call value_and_slope(frame%flank(:, frame%chart), frame%piece_end - frame%piece_begin, &
        g(0), g(1))
    ! Off kinks the jump is rounding, but left out it would add up to a mean force.
    g(1) = g(1) + table%slope_jump(frame%piece + 1)
    g(2:) = table%coefficient(2:, frame%piece + 1)
  end function on_next_piece

  !> The flank at the quarters of a step, at its end to the same bit as asked for alone.
  pure subroutine flank_over_step(table, frame, h, position, slope)
    type(te_table_t), intent(in) :: table                  !! motion of the flanks
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
    else if (h <= second_end(table, frame)) then
      g = on_next_piece(table, frame)
      do i = 1, 4
        if (s(i) <= frame%piece_end) then
          call value_and_slope(frame%flank(:, frame%chart), s(i), position(i), slope(i))
        else
          call value_and_slope(g, s(i) - frame%piece_end, position(i), slope(i))
        end if
      end do
    else
      do i = 1, 4
        piece = min(piece_at(table, frame%t + s(i)), frame%stop_knot - 1)
        call value_and_slope(table%coefficient(:, piece), &
            (frame%t + s(i)) - table%knot(piece), position(i), slope(i))
      end do
      position = (position - frame%origin) - frame%origin_rate*s
      slope = slope - frame%origin_rate
    end if
  end subroutine flank_over_step

  !> Distance to a flank over a frame's piece, about its beginning.
  pure subroutine distance_in_frame(frame, flank, motion, c)
    type(frame_t), intent(in) :: frame                     !! frame
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
