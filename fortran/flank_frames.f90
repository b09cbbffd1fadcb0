!> The Galilean frame of one step where every flank there is moves with the table: opened, moved on
!> piece by piece, and where the flank of its chart is at any time of the step.
module lapwing_flank_frames
  use lapwing_kinds, only: wp
  use lapwing_codes, only: drive_flank, coast_flank
  use lapwing_polynomial, only: max_degree, value_and_slope
  use lapwing_system, only: instant_t, frame_t
  use lapwing_transmission_error, only: te_table_t, piece_at, expand_at
  implicit none
  private
  public :: open_folded, fill_in, move_to, flank_in_frame, flank_over_step

contains

  !> The frame of a step in contact, its flanks left for `fill_in`: most steps never ask for them.
  pure subroutine open_folded(table, instant, frame)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    type(instant_t), intent(in) :: instant       !! where the step begins
    type(frame_t), intent(inout) :: frame        !! its frame
    frame%folded = .true.
    frame%chart = instant%chart
    frame%t = instant%t
    frame%piece = piece_at(table, instant%t)
    frame%piece_begin = 0
    frame%piece_end = table%knot(frame%piece + 1) - instant%t
    frame%stop_knot = table%next_felt(frame%piece)
    frame%stop = table%knot(frame%stop_knot) - instant%t
    call value_and_slope(table%coefficient(:, frame%piece), &
        instant%t - table%knot(frame%piece), frame%origin, frame%origin_rate)
  end subroutine open_folded

  !> Fill in the flanks of a frame that was opened without them.
  pure subroutine fill_in(table, width, frame)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    real(wp), intent(in) :: width                !! distance between them, rad
    type(frame_t), intent(inout) :: frame        !! frame as opened
    real(wp) :: g(0:max_degree)
    call expand_at(table, frame%piece, frame%t, g)
    g(0:1) = 0
    call set_flanks(g, width, frame)
    frame%folded = .false.
  end subroutine fill_in

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
    if (piece <= frame%piece) return
    frame%piece = piece
    frame%piece_begin = table%knot(piece) - frame%t
    frame%piece_end = table%knot(piece + 1) - frame%t
    g = table%coefficient(:, piece)
    g(0) = g(0) - frame%origin - frame%origin_rate*frame%piece_begin
    g(1) = g(1) - frame%origin_rate
    call set_flanks(g, width, frame)
  end subroutine move_to

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

  !> Position and velocity, in the frame, of the flank of its chart.
  pure subroutine flank_in_frame(table, frame, s, position, slope)
    type(te_table_t), intent(in) :: table        !! motion of the flanks
    type(frame_t), intent(in) :: frame           !! frame as opened
    real(wp), intent(in) :: s                    !! time since the frame was opened
    real(wp), intent(out) :: position, slope     !! in the frame
    integer :: piece
    ! What ends the step, at the last stage, has not happened yet.
    piece = min(piece_at(table, frame%t + s), frame%stop_knot - 1)
    call value_and_slope(table%coefficient(:, piece), frame%t + s - table%knot(piece), position, &
        slope)
    position = position - frame%origin - frame%origin_rate*s
    slope = slope - frame%origin_rate
  end subroutine flank_in_frame

  !> The same at the quarters of a step, to the same bit.
  pure subroutine flank_over_step(table, frame, h, position, slope)
    type(te_table_t), intent(in) :: table                  !! motion of the flanks
    type(frame_t), intent(in) :: frame                     !! frame as opened
    real(wp), intent(in) :: h                              !! step
    real(wp), intent(out) :: position(4), slope(4)         !! at its quarters, in the frame
    real(wp) :: s(4), x(4)
    integer :: i
    s = [1, 2, 3, 4]*(0.25_wp*h)
    if (h > frame%piece_end) then
      do i = 1, 4
        call flank_in_frame(table, frame, s(i), position(i), slope(i))
      end do
      return
    end if
    associate (c => table%coefficient(:, frame%piece))
      x = frame%t + s - table%knot(frame%piece)
      position = c(max_degree + 1)
      slope = 0
      do i = max_degree, 1, -1
        slope = slope*x + position
        position = position*x + c(i)
      end do
    end associate
    position = position - frame%origin - frame%origin_rate*s
    slope = slope - frame%origin_rate
  end subroutine flank_over_step
end module lapwing_flank_frames
