!> The step rule: the formula, its bounds, and what it does in closed loop.
program test_step_control
  use assertions, only: tally_t
  use lapwing_kinds, only: wp
  use lapwing_flow, only: step_memory_t
  use lapwing_flow_rk4_step_control, only: step_to_try, allowed_error, error_ratio, &
      after_accepted, after_rejected
  implicit none

  !> A few elementary functions, each good to some units.
  real(wp), parameter :: rounding = 20*epsilon(1.0_wp)
  type(tally_t) :: tally

  call test_to_try()
  call test_ratio()
  call test_rejected()
  call test_accepted()
  call test_cut_short()
  call test_closed_loop()
  call tally%finish()

contains

  !> What is remembered; else all there is, in contact the rung below 2 rtol**(3/16).
  subroutine test_to_try()
    type(step_memory_t) :: memory
    call tally%is_true(step_to_try(memory, .false., 1.0e-6_wp) >= huge(1.0_wp), "first flight")
    call tally%near(step_to_try(memory, .true., 2.0_wp**(-15)), 2.0_wp**(-15/8.0_wp), rounding, &
        "first contact")
    call tally%is_true(is_rung(step_to_try(memory, .true., 1.0e-6_wp)), "it is a rung")
    memory%step = 0.7_wp
    call tally%near(step_to_try(memory, .true., 1.0e-6_wp), 0.7_wp, 0.0_wp, "the next contact")
    ! A flight that nothing but a stop has ever cut short stays free.
    memory = step_memory_t()
    call after_accepted(memory, 0.3_wp, 0.0_wp, .true.)
    call tally%is_true(step_to_try(memory, .false., 1.0e-6_wp) >= huge(1.0_wp), "the next flight")
  end subroutine test_to_try

  !> A power of 2**(1/8).
  logical function is_rung(h)
    real(wp), intent(in) :: h
    real(wp) :: octaves
    octaves = 8*log(h)/log(2.0_wp)
    is_rung = abs(octaves - nint(octaves)) < 100*rounding
  end function is_rung

  !> Largest error in units of 1/96 of the tolerance times its size.
  subroutine test_ratio()
    call tally%near(error_ratio([1.0e-3_wp, 3.0e-3_wp], &
        allowed_error([1.0_wp, 6.0_wp], 1.0e-2_wp)), 9.6_wp, 9.6_wp*rounding, "error ratio")
    call tally%near(error_ratio([0.0_wp], [1.0_wp]), 0.0_wp, 0.0_wp, "no error")
  end subroutine test_ratio

  !> The rung below 0.9 ratio**(-1/4), at least below a tenth.
  subroutine test_rejected()
    call tally%near(after_rejected(2.0_wp, 16.0_wp), 2.0_wp**(-2/8.0_wp), rounding, &
        "after a rejection")
    call tally%near(after_rejected(2.0_wp, 1.0e12_wp), 2.0_wp**(-19/8.0_wp), rounding, "least step")
    call tally%below(after_rejected(1.0_wp, 1 + epsilon(1.0_wp)), 0.9_wp*(1 + rounding), &
        "a rejected step gets shorter")
  end subroutine test_rejected

  !> The rung nearest to 0.9 ratio**(-2/16) previous**(1/16), between 0.1 and 5.
  subroutine test_accepted()
    type(step_memory_t) :: memory
    memory%ratio = 0.3_wp
    ! 0.872 times as long: 1.6 rungs, two of them.
    call after_accepted(memory, 2.0_wp, 0.7_wp, .false.)
    call tally%near(memory%step, 2*2.0_wp**(-2/8.0_wp), 4*rounding, "after an accepted step")
    call tally%near(memory%ratio, 0.7_wp, 0.0_wp, "the ratio is remembered")
    memory%ratio = 0.3_wp
    call after_accepted(memory, 2.0_wp, 0.185_wp, .false.)
    call tally%near(memory%step, 2.0_wp, 0.0_wp, "close to the right length it is kept")
    call tally%near(memory%ratio, 0.185_wp, 0.0_wp, "its ratio is remembered")
    memory = step_memory_t()
    call after_accepted(memory, 1.0_wp, 0.0_wp, .false.)
    call tally%is_true(memory%step > 1 .and. memory%step <= 5, "an exact step grows, boundedly")
    call tally%is_true(memory%ratio > 0, "an exact step leaves a positive ratio")
    call after_accepted(memory, 1.0_wp, 1.0_wp, .false.)
    call tally%is_true(memory%step >= 0.1_wp, "the next one is not crushed by it")
  end subroutine test_accepted

  !> A step cut by an event or knot never shortens the next, but may lengthen it.
  subroutine test_cut_short()
    type(step_memory_t) :: memory
    memory%step = 1
    memory%ratio = 0.3_wp
    call after_accepted(memory, 1.0e-9_wp, 0.0_wp, .true.)
    call tally%near(memory%step, 1.0_wp, 0.0_wp, "a cut step does not shorten the next")
    call tally%near(memory%ratio, 0.3_wp, 0.0_wp, "a cut step is no experience")
    call after_accepted(memory, 0.9_wp, 1.0e-3_wp, .true.)
    call tally%is_true(memory%step > 1, "a cut step that was too good lengthens the next")
    memory = step_memory_t()
    call after_accepted(memory, 0.5_wp, 0.9_wp, .true.)
    call tally%is_true(memory%step >= 0.5_wp, "the first step of all, cut")
  end subroutine test_cut_short

  !> With an error of exactly C h**5 the factor would be 1 where 0.9 r**(-2/16 + 1/16) = 1, r =
  !> 0.9**16 = 0.185; the steps stop at the rung nearest to it.
  subroutine test_closed_loop()
    type(step_memory_t) :: memory
    real(wp), parameter :: c = 37
    real(wp) :: h, ratio, before
    integer :: i, rejected
    h = 8
    rejected = 0
    do i = 1, 30
      before = h
      ratio = c*h**5
      do while (ratio > 1)
        rejected = rejected + 1
        h = after_rejected(h, ratio)
        ratio = c*h**5
      end do
      call after_accepted(memory, h, ratio, .false.)
      h = memory%step
    end do
    call tally%is_true(ratio > 0.0925_wp .and. ratio < 0.372_wp, "the ratio settles")
    call tally%near(h, before, 0.0_wp, "and the step with it")
    call tally%is_true(rejected <= 3, "rejections at the start only")
  end subroutine test_closed_loop
end program test_step_control
