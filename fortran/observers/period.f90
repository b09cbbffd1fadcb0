!> The period of a motion in mesh cycles, from its stroboscopic section (docs/model.md, decision m).
!>
!> 1. For p = 1, 2, ... take the differences of states p cycles apart over the last max(2p, 8) such
!>    pairs. All must be within `repeat_tolerance`, and the labels must agree.
!> 2. A slow transient is no period. Differences above the noise are taken as a geometric series
!>    whose ratio the whole record shows; what it still sums to must be within the tolerance too.
!>    (Where they alternate that is less than the last of them.)
!> 3. A decaying flip is no period 2: while a multiplier is -0.9999 states two cycles apart agree
!>    to the last bits, those one cycle apart do not. Where the differences at a divisor of p still
!>    fade, p and its multiples are refused.
module lapwing_observers_period
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: period_of, longest_period, no_period, most_looked_for

  integer, parameter :: no_period = 0         !! aperiodic, as far as the record shows
  integer, parameter :: longest_period = 24   !! looked for where nothing else is asked
  integer, parameter :: most_looked_for = 10000   !! whatever is asked
  integer, parameter :: fewest_pairs = 8      !! that must agree

  !> Strobed states repeat when they agree to this part of the motion's size.
  real(wp), parameter :: repeat_tolerance = 1e-8_wp
  !> Differences this small need not fall any further: the last bits of a state move the adaptive
  !> steps, and those move the cycles of a settled motion by up to some 1e-11 of its size.
  real(wp), parameter :: noise_floor = 1e-10_wp
  !> A difference fades when the means of two quarters of the record fall by more than this: of the
  !> motion's size, what noise leaves of a mean of some 25 cycles with a margin of three, and of
  !> itself, so that the last steps of a transient are not taken for it.
  real(wp), parameter :: fading = 1e-11_wp, fading_part = 1e-5_wp

contains

  !> Smallest number of cycles after which a motion repeats, or `no_period`.
  pure integer function period_of(cycles, first_state, labels, scale, most) result(period)
    real(wp), intent(in) :: cycles(:, :)   !! (columns, n) a line for each cycle
    integer, intent(in) :: first_state     !! column of phi at its beginning; behind it phi'
    integer, intent(in) :: labels(:)       !! columns that must match besides
    real(wp), intent(in) :: scale          !! size of the motion, rad, > 0
    integer, intent(in) :: most            !! longest period looked for
    logical :: fades(most_looked_for)      !! by divisor: whether its differences still fade
    integer :: p, q, n, pairs
    period = no_period
    n = size(cycles, 2)
    associate (states => cycles(first_state:first_state + 1, :))
      if (.not. all(ieee_is_finite(states))) return
      do p = 1, min(most, most_looked_for)
        fades(p) = .false.
        pairs = max(2*p, fewest_pairs)
        if (n < pairs + p) return
        if (.not. repeats(states, scale, p, pairs)) cycle
        if (.not. match(cycles(:, n - pairs - p + 1:), labels, p)) cycle
        do q = 1, p - 1
          if (mod(p, q) == 0 .and. .not. fades(q)) fades(q) = still_fades(states, scale, q, p)
        end do
        if (any([(fades(q) .and. mod(p, q) == 0, q=1, p)])) cycle
        period = p
        return
      end do
    end associate
  end function period_of

  !> Whether the last pairs of cycles p apart agree, and will go on doing so.
  pure logical function repeats(states, scale, p, pairs)
    real(wp), intent(in) :: states(:, :), scale   !! (2, n), see `period_of`
    integer, intent(in) :: p, pairs               !! cycles apart, pairs compared
    real(wp) :: last, early, late, ratio
    integer :: i, n, half
    n = size(states, 2)
    repeats = .false.
    last = 0
    do i = n - p, n - p - pairs + 1, -1
      last = max(last, maxval(abs(step(states, scale, i, p))))
      if (last > repeat_tolerance) return
    end do
    if (last > noise_floor .and. .not. alternates(states, scale, p, pairs)) then
      half = (n - p)/2
      early = largest_step(states, scale, p, 1, half)
      late = largest_step(states, scale, p, half + 1, n - p)
      if (.not. late < early) return
      ratio = (late/early)**(real(p, wp)/half)
      if (.not. last <= repeat_tolerance*(1 - ratio)) return
    end if
    repeats = .true.
  end function repeats

  !> Whether labels agree between all cycles p apart.
  pure logical function match(cycles, labels, p)
    real(wp), intent(in) :: cycles(:, :)          !! (columns, n)
    integer, intent(in) :: labels(:), p           !! columns compared, cycles apart
    integer :: i, k
    match = .false.
    do i = 1, size(cycles, 2) - p
      do k = 1, size(labels)
        if (cycles(labels(k), i) /= cycles(labels(k), i + p)) return
      end do
    end do
    match = .true.
  end function match

  !> Whether steps over p cycles turn round, on the whole, from one to the next.
  pure logical function alternates(states, scale, p, pairs)
    real(wp), intent(in) :: states(:, :), scale   !! (2, n), see `period_of`
    integer, intent(in) :: p, pairs               !! cycles apart, pairs compared
    real(wp) :: products
    integer :: i, n
    n = size(states, 2)
    products = 0
    do i = max(1, n - 2*p - pairs + 1), n - 2*p
      products = products + dot_product(step(states, scale, i + p, p), step(states, scale, i, p))
    end do
    alternates = products < 0
  end function alternates

  !> Whether the differences of states q cycles apart, seen every p cycles, still die out.
  pure logical function still_fades(states, scale, q, p)
    real(wp), intent(in) :: states(:, :), scale   !! (2, n), see `period_of`
    integer, intent(in) :: q, p                   !! cycles apart, a multiple of it
    real(wp) :: mean(2)                           !! over the last quarter but one, and the last
    integer :: i, length, quarter
    length = size(states, 2) - q
    quarter = max(length/(4*p), 1)*p
    still_fades = .false.
    if (length < 2*quarter) return
    mean = 0
    do i = 1, quarter
      mean = mean + [maxval(abs(step(states, scale, length - 2*quarter + i, q))), &
          maxval(abs(step(states, scale, length - quarter + i, q)))]
    end do
    mean = mean/quarter
    still_fades = mean(1) - mean(2) > max(fading, fading_part*mean(2))
  end function still_fades

  pure real(wp) function largest_step(states, scale, p, first, last)
    real(wp), intent(in) :: states(:, :), scale   !! (2, n), see `period_of`
    integer, intent(in) :: p, first, last         !! cycles apart; cycles at which steps begin
    integer :: i
    largest_step = 0
    do i = first, last
      largest_step = max(largest_step, maxval(abs(step(states, scale, i, p))))
    end do
  end function largest_step

  !> From cycle i on over p cycles, in parts of the motion's size.
  pure function step(states, scale, i, p)
    real(wp), intent(in) :: states(:, :), scale   !! (2, n), see `period_of`
    integer, intent(in) :: i, p                   !! cycle, cycles apart
    real(wp) :: step(2)
    step = states(:, i + p)/scale - states(:, i)/scale
  end function step
end module lapwing_observers_period
