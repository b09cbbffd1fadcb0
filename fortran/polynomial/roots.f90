!> Every root of a polynomial on an interval, isolated by the sign variations of its Bernstein
!> coefficients (Descartes' rule on an interval: no variation, no root; one variation, exactly one
!> root), intervals with more are halved.
module lapwing_polynomial_roots
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree, horner, horner_slope, taylor_shift, &
      bernstein, scale_to_unit, never_below, least, jet, bend_beyond
  implicit none
  private
  public :: first_zero, first_descent, critical_points, lift_off, first_nonzero, newton
  public :: raise_to_largest, raise_to_turn, raise_to_vertex, is_parabola, parabola_descent

  !> Halvings before two roots closer than 2**-48 of the interval are treated as one.
  integer, parameter :: max_depth = 48
  !> Newton steps of the bracketed solver; bisection alone would need fewer than this.
  integer, parameter :: max_iterations = 80
  !> Newton steps from a guess; from four digits two are needed, from half of one five.
  integer, parameter :: max_newton = 12
  !> Newton's step to a turn at which the parabola there gives its value to rounding: what it leaves
  !> out is the cube of the step, over the interval.
  real(wp), parameter :: close_enough = 3.0e-6_wp
  integer, parameter :: most_steps = 12        !! of Newton; four or five are needed
  integer, parameter :: rough_steps = 2        !! of them with the first six terms

contains

  !> Make a polynomial that leaves zero at the origin positive there: divide by x as often as the
  !> leading coefficient is not positive. `times`: how often.
  pure subroutine lift_off(c, times)
    real(wp), intent(inout) :: c(0:max_degree)  !! coefficients
    integer, intent(out) :: times               !! divisions made; max_degree + 1: nothing left
    do times = 0, max_degree
      if (c(0) > 0) return
      c(0:max_degree - 1) = c(1:max_degree)
      c(max_degree) = 0
    end do
  end subroutine lift_off

  !> First x in (0, length] where a polynomial that is positive at 0 is no longer positive.
  !> Right to the rounding of its terms, sum |c_k| length**k, which decides where roots meet.
  !> To the last bits, or to `rough` of the interval.
  pure subroutine first_zero(c, length, found, x, rough)
    real(wp), intent(in) :: c(0:max_degree)  !! coefficients, c(0) > 0
    real(wp), intent(in) :: length           !! interval
    logical, intent(out) :: found            !! whether there is one
    real(wp), intent(out) :: x               !! where
    real(wp), intent(in), optional :: rough  !! error allowed, over the interval
    real(wp) :: scaled(0:max_degree), b(0:max_degree), allowed
    call scale_to_unit(c, length, scaled)
    found = .false.
    x = length
    if (never_below(scaled) > 0) return
    b = bernstein(scaled)
    if (least(b) > 0) return
    ! Not a number: nothing to isolate; whoever moves the state sees it and says so.
    if (.not. abs(sum(b)) <= huge(x)) return
    allowed = 0
    if (present(rough)) allowed = rough
    call first_zero_on_unit(scaled, b, allowed, found, x)
    x = x*length
  end subroutine first_zero

  !> First zero of a distance that may begin at zero.
  !>
  !> Where it does and the next move there is decided (`leaves`), or where it rises, the zero is
  !> divided out; leading coefficients that contradict the decision are rounding and go with it.
  !> A distance that begins at or, by rounding, below zero and falls is a crossing at once.
  pure subroutine first_descent(c, length, leaves, found, at)
    real(wp), intent(inout) :: c(0:max_degree)   !! coefficients, changed where they begin at zero
    real(wp), intent(in) :: length               !! interval
    logical, intent(in) :: leaves                !! whether it is known to rise from zero
    logical, intent(out) :: found                !! whether there is a zero
    real(wp), intent(out) :: at                  !! where
    integer :: times
    found = .false.
    at = 0
    if (length < 0) return
    if (c(0) <= 0) then
      found = .not. leaves .and. first_nonzero(c(1:)) < 0
      if (found) return
      call lift_off(c, times)
      if (times > max_degree) return
    end if
    call first_zero(c, length, found, at)
  end subroutine first_descent

  !> Whether a polynomial has no terms beyond the square.
  pure logical function is_parabola(c)
    real(wp), intent(in) :: c(0:max_degree)      !! coefficients
    is_parabola = c(3) == 0 .and. c(4) == 0 .and. c(5) == 0
  end function is_parabola

  !> `first_descent` of a parabola, by formula: of the two ways to write a root the one that
  !> subtracts nothing.
  pure subroutine parabola_descent(c, length, leaves, found, at)
    real(wp), intent(in) :: c(0:2)               !! coefficients
    real(wp), intent(in) :: length               !! interval
    logical, intent(in) :: leaves                !! whether it is known to rise from zero
    logical, intent(out) :: found                !! whether there is a zero
    real(wp), intent(out) :: at                  !! where
    real(wp) :: square
    found = .false.
    at = 0
    if (.not. length >= 0) return
    if (c(0) > 0) then
      ! It is nowhere below what its falling terms alone would make of it.
      if (c(0) + (min(c(1), 0.0_wp) + min(c(2), 0.0_wp)*length)*length > 0) return
      square = c(1)**2 - 4*c(2)*c(0)
      if (.not. square >= 0) return
      if (c(1) < 0) then
        at = 2*c(0)/(sqrt(square) - c(1))
      else
        at = -(sqrt(square) + c(1))/(2*c(2))
      end if
    else if (.not. leaves .and. (c(1) < 0 .or. (c(1) == 0 .and. c(2) < 0))) then
      found = .true.
      return
    else
      if (.not. (c(1) > 0 .and. c(2) < 0)) return
      at = -c(1)/c(2)
    end if
    found = at <= length
  end subroutine parabola_descent

  !> Leftmost sign change on [0, 1], by halving until one variation is left.
  pure subroutine first_zero_on_unit(c, b_whole, allowed, found, x)
    real(wp), intent(in) :: c(0:max_degree)        !! coefficients
    real(wp), intent(in) :: b_whole(0:max_degree)  !! Bernstein coefficients on [0, 1]
    real(wp), intent(in) :: allowed                !! error allowed
    logical, intent(out) :: found                  !! whether there is one
    real(wp), intent(out) :: x                     !! where
    real(wp) :: b(0:max_degree, 0:max_depth), lower(0:max_depth), width(0:max_depth)
    integer :: top, variations
    found = .false.
    x = 1  ! the end, unless something is found before it
    top = 0
    b(:, 0) = b_whole
    lower(0) = 0
    width(0) = 1
    do while (top >= 0)
      variations = sign_variations(b(:, top))
      if (b(0, top) <= 0) then
        found = .true.
        x = lower(top)
        return
      else if (variations == 0) then
        ! Only the interval at the bottom of the stack ends where the polynomial does.
        found = top == 0 .and. b(max_degree, top) <= 0
        if (found) return
        top = top - 1
      else if (variations == 1 .and. b(max_degree, top) <= 0) then
        found = .true.
        x = bracketed_root(c, lower(top), lower(top) + width(top), allowed)
        return
      else if (top == max_depth) then
        ! A double root to the last bits: it counts where the polynomial does not stay positive.
        found = min(horner(c, lower(top) + 0.5_wp*width(top)), minval(b(:, top))) <= 0
        x = lower(top) + 0.5_wp*width(top)
        if (found) return
        x = 1
        top = top - 1
      else
        call halve(b, lower, width, top)
      end if
    end do
  end subroutine first_zero_on_unit

  !> Replace the interval on top of the stack by its right half and put its left half above it.
  pure subroutine halve(b, lower, width, top)
    real(wp), intent(inout) :: b(0:max_degree, 0:max_depth)              !! Bernstein coefficients
    real(wp), intent(inout) :: lower(0:max_depth), width(0:max_depth)    !! intervals
    integer, intent(inout) :: top                                        !! top of the stack
    integer :: i, k
    real(wp) :: left(0:max_degree)
    left(0) = b(0, top)
    do i = 1, max_degree
      do k = 0, max_degree - i
        b(k, top) = 0.5_wp*(b(k, top) + b(k + 1, top))
      end do
      left(i) = b(0, top)
    end do
    width(top) = 0.5_wp*width(top)
    lower(top + 1) = lower(top)
    width(top + 1) = width(top)
    lower(top) = lower(top) + width(top)
    top = top + 1
    b(:, top) = left
  end subroutine halve

  !> Number of sign changes in a row of coefficients, zeros passed over.
  pure integer function sign_variations(b)
    real(wp), intent(in) :: b(0:max_degree)  !! coefficients
    integer :: i
    real(wp) :: last
    sign_variations = 0
    last = b(0)
    do i = 1, max_degree
      if (b(i) == 0) cycle
      if (last > 0 .neqv. b(i) > 0) sign_variations = sign_variations + 1
      last = b(i)
    end do
  end function sign_variations

  !> The one root between lower, where the polynomial is positive, and upper: Newton kept in its
  !> bracket. A value that rounds to zero or below at lower puts the root there.
  pure real(wp) function bracketed_root(c, lower, upper, allowed) result(x)
    real(wp), intent(in) :: c(0:max_degree)  !! coefficients
    real(wp), intent(in) :: lower, upper     !! bracket
    real(wp), intent(in) :: allowed          !! error allowed
    real(wp) :: a, b, value, slope, step
    integer :: iteration
    a = lower
    b = upper
    x = a
    do iteration = 1, max_iterations
      value = horner(c, x)
      slope = horner_slope(c, x)
      if (value > 0) then
        a = x
      else
        b = x
      end if
      step = merge(-value/slope, huge(1.0_wp), slope /= 0)
      if (x + step <= a .or. x + step >= b) then
        if (abs(step) <= epsilon(x)*abs(x)) return
        step = 0.5_wp*(a + b) - x
      end if
      x = x + step
      if (abs(step) <= max(2*epsilon(x)*abs(x), allowed) .or. value == 0) return
    end do
  end function bracketed_root

  !> Newton's way from a guess to a zero that is near, of a polynomial that falls: `found` is
  !> whether it fell all the way.
  pure subroutine newton(c, lower, upper, absolute, relative, x, slope, found)
    real(wp), intent(in) :: c(0:)                !! coefficients
    real(wp), intent(in) :: lower, upper         !! x is kept between them
    real(wp), intent(in) :: absolute, relative   !! a step below absolute + relative*|x| ends it
    real(wp), intent(inout) :: x                 !! guess, then the zero
    real(wp), intent(out) :: slope               !! before the last step
    logical, intent(out) :: found
    real(wp) :: step
    integer :: i
    found = .false.
    do i = 1, max_newton
      slope = horner_slope(c, x)
      if (slope >= 0) return
      step = -horner(c, x)/slope
      x = min(max(x + step, lower), upper)
      if (abs(step) <= absolute + relative*abs(x)) exit
    end do
    found = .true.
  end subroutine newton

  !> Raise `most` to the largest value on [0, length]: at its ends or at a turn.
  pure subroutine raise_to_largest(c, length, most)
    real(wp), intent(in) :: c(0:max_degree)      !! coefficients
    real(wp), intent(in) :: length               !! interval
    real(wp), intent(inout) :: most              !! largest value
    real(wp) :: at(max_degree)
    integer :: i, n
    if (is_parabola(c)) then
      call raise_to_vertex(c(0:2), length, most)
      return
    end if
    most = max(most, c(0), horner(c, length))
    call critical_points(c, length, n, at)
    do i = 1, n
      most = max(most, horner(c, at(i)))
    end do
  end subroutine raise_to_largest

  !> The same of a parabola, by formula.
  pure subroutine raise_to_vertex(c, length, most)
    real(wp), intent(in) :: c(0:2)               !! coefficients
    real(wp), intent(in) :: length               !! interval
    real(wp), intent(inout) :: most              !! largest value
    most = max(most, c(0), c(0) + (c(1) + c(2)*length)*length)
    if (c(1) > 0 .and. c(1) + 2*c(2)*length < 0) most = max(most, c(0) - 0.25_wp*c(1)**2/c(2))
  end subroutine raise_to_vertex

  !> All x in (0, length) where the derivative changes sign, in increasing order.
  pure subroutine critical_points(c, length, n, x)
    real(wp), intent(in) :: c(0:max_degree)        !! coefficients
    real(wp), intent(in) :: length                 !! interval
    integer, intent(out) :: n                      !! number of points
    real(wp), intent(out) :: x(max_degree)         !! the points
    real(wp) :: derivative(0:max_degree), rest(0:max_degree), root, from
    logical :: found
    integer :: i, times
    derivative = [(i*c(i), i = 1, max_degree), 0.0_wp]
    n = 0
    from = 0
    do while (from < length .and. n < max_degree)
      rest = derivative
      call taylor_shift(rest, from)
      if (n > 0) rest(0) = 0
      if (first_nonzero(rest) < 0) rest = -rest
      call lift_off(rest, times)
      if (times > max_degree) return
      call first_zero(rest, length - from, found, root)
      if (.not. found .or. from + root >= length .or. root <= 0) return
      from = from + root
      n = n + 1
      x(n) = from
    end do
  end subroutine critical_points

  !> The lowest coefficient that is not zero, or zero.
  pure real(wp) function first_nonzero(c)
    real(wp), intent(in) :: c(0:)  !! coefficients
    integer :: i
    first_nonzero = 0
    do i = 0, ubound(c, 1)
      first_nonzero = c(i)
      if (first_nonzero /= 0) return
    end do
  end function first_nonzero

  !> Raise `most` to the largest value of a polynomial of odd degree, five at least, if its second
  !> derivative keeps its sign on the interval: then it turns once or not at all.
  pure subroutine raise_to_turn(c, from, to, most, one_turn)
    real(wp), intent(in), contiguous :: c(0:)  !! coefficients
    real(wp), intent(in) :: from, to           !! interval
    real(wp), intent(inout) :: most            !! largest value
    logical, intent(out) :: one_turn           !! whether it does
    real(wp) :: value, slope, bend, s, step, slopes(2)
    integer :: i
    one_turn = bend_beyond(c, max(abs(from), abs(to))) < 1.9_wp*abs(c(2))
    if (.not. one_turn) return
    slopes = 0
    if (c(2) < 0) slopes = [horner_slope(c, from), horner_slope(c, to)]
    if (slopes(1) <= 0 .or. slopes(2) >= 0) then
      most = max(most, horner(c, from), horner(c, to))
      return
    end if
    s = from + (to - from)*(slopes(1)/(slopes(1) - slopes(2)))
    do i = 1, most_steps
      ! A guess need not know all terms.
      call jet(merge(max_degree, ubound(c, 1), i <= rough_steps), c, s, value, slope, bend)
      step = -0.5_wp*slope/bend
      if (i > rough_steps .and. abs(step) <= close_enough*(to - from)) exit
      s = min(max(s + step, from), to)
    end do
    one_turn = i <= most_steps
    if (one_turn) most = max(most, value + 0.5_wp*slope*step)
  end subroutine raise_to_turn
end module lapwing_polynomial_roots
