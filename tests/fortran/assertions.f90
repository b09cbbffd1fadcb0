!> Assertions of the Fortran tests: say what failed, with numbers, and go on; the program ends with
!> a non-zero exit status if anything has failed.
module assertions
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: tally_t

  !> What one test program has found.
  type :: tally_t
    integer :: checks = 0     !! assertions made
    integer :: failures = 0   !! of them failed
  contains
    procedure :: is_true, equal, near, below, finish
  end type tally_t

  !> Failures printed; the rest is counted only.
  integer, parameter :: most_printed = 40

contains

  !> A condition holds.
  subroutine is_true(self, condition, what)
    class(tally_t), intent(inout) :: self
    logical, intent(in) :: condition    !! what must be true
    character(*), intent(in) :: what    !! in words
    call count_check(self, condition)
    if (say(self, condition)) print "(2a)", "FAILED: ", what
  end subroutine is_true

  !> Two integers are equal.
  subroutine equal(self, found, expected, what)
    class(tally_t), intent(inout) :: self
    integer, intent(in) :: found        !! what came out
    integer, intent(in) :: expected     !! what should have
    character(*), intent(in) :: what    !! in words
    call count_check(self, found == expected)
    if (say(self, found == expected)) then
      print "(3a, i0, a, i0)", "FAILED: ", what, ": ", found, ", expected ", expected
    end if
  end subroutine equal

  !> A number is as expected, within an absolute tolerance. No comparison is made with NaN.
  subroutine near(self, found, expected, tolerance, what)
    class(tally_t), intent(inout) :: self
    real(wp), intent(in) :: found       !! what came out
    real(wp), intent(in) :: expected    !! what should have
    real(wp), intent(in) :: tolerance   !! largest deviation, absolute
    character(*), intent(in) :: what    !! in words
    logical :: good
    good = is_number(found)
    if (good) good = abs(found - expected) <= tolerance
    call count_check(self, good)
    if (say(self, good)) print "(3a, es24.16, a, es24.16, 2(a, es10.2))", "FAILED: ", what, ": ", &
        found, ", expected ", expected, ", off by ", found - expected, ", allowed ", tolerance
  end subroutine near

  !> A number does not exceed a bound.
  subroutine below(self, found, bound, what)
    class(tally_t), intent(inout) :: self
    real(wp), intent(in) :: found       !! what came out
    real(wp), intent(in) :: bound       !! largest value allowed
    character(*), intent(in) :: what    !! in words
    logical :: good
    good = is_number(found)
    if (good) good = found <= bound
    call count_check(self, good)
    if (say(self, good)) print "(3a, es24.16, a, es24.16)", "FAILED: ", what, ": ", found, &
        ", allowed up to ", bound
  end subroutine below

  !> End the program: status 1 if anything failed or nothing was checked.
  subroutine finish(self)
    class(tally_t), intent(in) :: self
    print "(i0, a, i0, a)", self%checks, " checks, ", self%failures, " failed"
    if (self%failures > 0 .or. self%checks == 0) error stop 1
  end subroutine finish

  subroutine count_check(self, good)
    class(tally_t), intent(inout) :: self
    logical, intent(in) :: good         !! whether the assertion held
    self%checks = self%checks + 1
    if (.not. good) self%failures = self%failures + 1
  end subroutine count_check

  !> Whether a failure is to be printed.
  logical function say(self, good)
    class(tally_t), intent(in) :: self
    logical, intent(in) :: good         !! whether the assertion held
    say = .not. good .and. self%failures <= most_printed
  end function say

  !> Without trapping: an invalid comparison would end the program before it could say why.
  logical function is_number(x)
    use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
    real(wp), intent(in) :: x           !! any number
    is_number = .not. ieee_is_nan(x)
  end function is_number
end module assertions
