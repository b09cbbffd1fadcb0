!> What the recorded cycles of a motion come to, in a few numbers: its period, what arrives in one,
!> extremes.
module lapwing_observers_motion_class
  use lapwing_kinds, only: wp
  use lapwing_codes, only: law_compliant
  use lapwing_observers_period, only: period_of, longest_period, no_period
  use lapwing_observers_records, only: column_state, column_phi, column_counted, column_engages, &
      column_chatter_ends, column_depth, column_visited
  implicit none
  private
  public :: motion_class, class_columns

  !> Period, arrivals at either flank, chatter; deepest separation and penetration of the coast
  !> flank, motion states visited.
  integer, parameter :: class_columns = 7

  !> What must match between the cycles of a periodic motion: the strobed motion state, counted
  !> impacts, releases, engages and chatter ends. Impacts of a resolved chatter are left out: how
  !> many are listed before a chatter is summed is a matter of the last bit.
  integer, parameter :: labels(9) = [column_state, column_counted, column_counted + 1, &
      column_counted + 2, column_counted + 3, column_engages, column_engages + 1, &
      column_chatter_ends, column_chatter_ends + 1]

contains

  !> Period (0: none), arrivals at the drive and at the coast flank in the last period (in all
  !> cycles where there is none), whether a chatter was complete in any cycle (1), extremes.
  !>
  !> An arrival is a counted impact; without impacts (`compliant`) it is an engagement.
  pure function motion_class(cycles, force, backlash, contact_law) result(row)
    real(wp), intent(in) :: cycles(:, :)   !! (columns, n) a line for each cycle, see `records`
    real(wp), intent(in) :: force          !! mean force, rad
    real(wp), intent(in) :: backlash       !! rad
    integer, intent(in) :: contact_law     !! law_*
    real(wp) :: row(class_columns)
    real(wp) :: scale
    integer :: period, arrivals, first, visited, i, n
    n = size(cycles, 2)
    scale = max(abs(force), maxval(cycles(column_depth, :)))
    if (scale <= 0) scale = backlash
    period = period_of(cycles, column_phi, labels, scale, longest_period)
    arrivals = merge(column_engages, column_counted, contact_law == law_compliant)
    row = 0
    row(1) = period
    first = merge(1, n - period + 1, period == no_period)
    row(2:3) = sum(cycles(arrivals:arrivals + 1, first:), 2)
    if (any(cycles(column_chatter_ends:column_chatter_ends + 1, :) > 0)) row(4) = 1
    row(5:6) = maxval(cycles(column_depth:column_depth + 1, :), 2)
    visited = 0
    do i = 1, n
      visited = ior(visited, nint(cycles(column_visited, i)))
    end do
    row(7) = visited
  end function motion_class
end module lapwing_observers_motion_class
