!> The end of a complete chatter: the sum against bounce after bounce in quadruple precision.
program test_chatter
  use, intrinsic :: iso_fortran_env, only: real128
  use assertions, only: tally_t
  use lapwing_hybrid_chatter, only: remaining_chatter, below_resolution, listed_down_to, &
      summed_up_to
  use lapwing_kinds, only: wp
  implicit none

  integer, parameter :: qp = real128
  !> A period so long and a tolerance so wide that no chatter is refused for being long.
  real(wp), parameter :: long_period = 1.0e9_wp, no_tolerance = 1
  type(tally_t) :: tally

  call test_constant()
  call test_bound()
  call test_order()
  call test_accuracy_when_ended()
  call test_refusals()
  call test_resolution()
  call tally%finish()

contains

  !> Duration of all bounces: distance u**2 times a cubic below a parabola, bounce by bounce.
  function direct_sum(pressing, speed, restitution) result(total)
    real(wp), intent(in) :: pressing(0:5)   !! a + j s + k s**2 + m s**3
    real(wp), intent(in) :: speed           !! after the first impact
    real(wp), intent(in) :: restitution     !! eps
    real(qp) :: total, v, c(0:3), u, move
    integer :: i
    total = 0
    v = speed
    do while (v > 1.0e-22_qp*speed)
      c = pressing(0:3)
      c = [c(0) + total*(c(1) + total*(c(2) + total*c(3))), c(1) + total*(2*c(2) + 3*total*c(3)), &
          c(2) + 3*total*c(3), c(3)]
      ! v = u (c0/2 + u (c1/6 + u (c2/12 + u c3/20))) by Newton from the parabola.
      u = 2*v/c(0)
      do i = 1, 60
        move = (v - u*(c(0)/2 + u*(c(1)/6 + u*(c(2)/12 + u*c(3)/20)))) &
            /(c(0)/2 + u*(c(1)/3 + u*(c(2)/4 + u*c(3)/5)))
        u = u + move
        if (abs(move) <= 1.0e-30_qp*u) exit
      end do
      v = restitution*(u*(c(0) + u*(c(1)/2 + u*(c(2)/3 + u*c(3)/4))) - v)
      total = total + u
      if (restitution == 0) return
    end do
    ! The rest is 2v/(a (1 - eps)), below 1e-22 of the whole.
  end function direct_sum

  !> What model.md, decision i, says is neglected.
  pure real(wp) function neglected(p, v, eps)
    real(wp), intent(in) :: p(0:5), v, eps   !! pressing, speed, restitution
    real(wp) :: r
    r = 2*abs(p(1))*v/(3*p(0)**2*(1 - eps))
    neglected = 2*v/(p(0)*(1 - eps))*(r**2 + 2*abs(p(2))*v**2/(p(0)**3*(1 - eps)**2))
  end function neglected

  !> Constant pressing: the geometric series 2v/(a(1 - eps)).
  subroutine test_constant()
    real(wp) :: duration
    logical :: ends
    call remaining_chatter([2.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], 0.5_wp, 0.75_wp, &
        long_period, listed_down_to, 0.0_wp, long_period, ends, duration)
    call tally%is_true(ends, "constant pressing: ends")
    call tally%near(duration, 2.0_wp, 4*epsilon(duration), "constant pressing")
    call tally%near(real(direct_sum([2.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], 0.5_wp, &
        0.75_wp), wp), 2.0_wp, 4*epsilon(duration), "constant pressing, bounce by bounce")
  end subroutine test_constant

  !> The error of the sum is within the part said to be neglected, up to a factor: the second-order
  !> term of the exact sum is T1 (alpha r**2 + beta |g''''| ...) with alpha and beta functions of
  !> eps of the order of one, evaluated here by brute force; 3 covers them and terms of order r**3.
  subroutine test_bound()
    real(wp), parameter :: restitution(5) = [0.0_wp, 0.3_wp, 0.6_wp, 0.8_wp, 0.95_wp]
    real(wp) :: p(0:5), v, duration, worst, random(4)
    real(qp) :: exact
    logical :: ends
    integer :: i, e
    call random_seed_fixed()
    worst = 0
    do i = 1, 400
      call random_number(random)
      e = 1 + mod(i, 5)
      p = 0
      p(0) = 0.5_wp + random(1)
      p(1:3) = 2*random(2:4) - 1
      v = 1.0e-3_wp*(1 - restitution(e))
      call remaining_chatter(p, v, restitution(e), long_period, listed_down_to, no_tolerance, &
          long_period, ends, duration)
      if (.not. ends .or. neglected(p, v, restitution(e)) < 1.0e-12_wp) cycle
      exact = direct_sum(p, v, restitution(e))
      worst = max(worst, abs(real(duration - exact, wp))/neglected(p, v, restitution(e)))
    end do
    print "(a, f8.4)", "measured: error of the sum over what is called neglected, at most ", worst
    call tally%below(worst, 3.0_wp, "error of the sum over what is called neglected")
  end subroutine test_bound

  !> Both terms of the formula are right: the error falls with the cube of the speed.
  subroutine test_order()
    real(wp), parameter :: p(0:5) = [1.0_wp, 0.7_wp, -0.4_wp, 0.3_wp, 0.0_wp, 0.0_wp]
    real(wp), parameter :: eps = 0.8_wp
    real(wp) :: v, duration, error(2), slope
    logical :: ends
    integer :: i
    do i = 1, 2
      v = 1.0e-3_wp/2**i
      call remaining_chatter(p, v, eps, long_period, listed_down_to, no_tolerance, long_period, &
          ends, duration)
      error(i) = abs(real(duration - direct_sum(p, v, eps), wp))
    end do
    slope = log(error(1)/error(2))/log(2.0_wp)
    print "(a, f7.3)", "measured: order of the chatter sum in the speed ", slope
    ! The next term is smaller by T1 |j|/a = 0.004, so that the exponent is off by as much.
    call tally%near(slope, 3.0_wp, 0.05_wp, "order of the chatter sum")
  end subroutine test_order

  !> Whenever a chatter is ended the time of its end is within `chatter_tol` of a mesh period (times
  !> the factor of `test_bound`), whatever the speed; slow enough a chatter is always ended.
  subroutine test_accuracy_when_ended()
    real(wp), parameter :: p(0:5) = [0.3_wp, 0.5_wp, -0.8_wp, 0.2_wp, 0.0_wp, 0.0_wp]
    real(wp), parameter :: period = 5, tolerance = 1.0e-13_wp
    real(wp) :: v, duration
    logical :: ends
    ! 2v/(0.3*0.3) <= 1e-7*5: v below 2.2e-8, that is i from 39 on. Without that bound 2v/(0.3*0.3)
    ! times (0.5*v/(3*0.3**2*0.3/2))**2 + 1.6*v**2/(0.3**3*0.3**2) is below 5e-13 from i = 28 on.
    integer, parameter :: expected(2) = [22, 33]
    integer :: i, k, n_ended
    do k = 1, 2
      n_ended = 0
      do i = 0, 60
        v = 10.0_wp**(-0.2_wp*i)
        call remaining_chatter(p, v, 0.7_wp, period, merge(listed_down_to, summed_up_to, k == 1), &
            tolerance, 1.0_wp, ends, duration)
        if (.not. ends) cycle
        n_ended = n_ended + 1
        call tally%near(real(duration - direct_sum(p, v, 0.7_wp), wp), 0.0_wp, &
            3*tolerance*period, "end of a chatter")
      end do
      call tally%equal(n_ended, expected(k), "chatters ended")
    end do
  end subroutine test_accuracy_when_ended

  subroutine refused(pressing, speed, restitution, free, what)
    real(wp), intent(in) :: pressing(0:5), speed, restitution, free   !! see remaining_chatter
    character(*), intent(in) :: what                                  !! in words
    real(wp) :: duration
    logical :: ends
    call remaining_chatter(pressing, speed, restitution, 1.0_wp, listed_down_to, 1.0e-10_wp, &
        free, ends, duration)
    call tally%is_true(.not. ends, "not a complete chatter: "//what)
  end subroutine refused

  subroutine test_refusals()
    real(wp), parameter :: p(0:5) = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    real(wp), parameter :: falling(0:5) = [1.0_wp, -2.0e7_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    real(wp), parameter :: rising(0:5) = [1.0_wp, 1.5e8_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    real(wp), parameter :: v = 1.0e-9_wp
    real(wp) :: duration
    logical :: ends
    call remaining_chatter(p, v, 0.5_wp, 1.0_wp, listed_down_to, 1.0e-10_wp, 1.0_wp, ends, &
        duration)
    call tally%is_true(ends, "the case that the refusals vary")
    call refused(-p, v, 0.5_wp, 1.0_wp, "pulled away")
    call refused(0*p, v, 0.5_wp, 1.0_wp, "no force")
    call refused(p, v, 1.0_wp, 1.0_wp, "elastic")
    call refused(p, 0.0_wp, 0.5_wp, 1.0_wp, "at rest")
    call refused(p, -v, 0.5_wp, 1.0_wp, "moving in")
    call refused(p, 1.0e-3_wp, 0.5_wp, 1.0_wp, "too long")
    call refused(p, v, 0.5_wp, 2*v, "a knot inside")
    ! r = 2*1.5e8*v/(3*0.5) = 0.2: what is neglected is 4 v r**2 = 1.6e-10 periods.
    call refused(rising, v, 0.5_wp, 1.0_wp, "the sum is not accurate enough")
    call refused(falling, 1.0e-8_wp, 0.5_wp, 1.0_wp, "pressing ends inside")
  end subroutine test_refusals

  !> 2v/a up to 4 units in the last place of time.
  subroutine test_resolution()
    real(wp) :: v
    v = 0.5_wp*4*spacing(7.0_wp)*3.0_wp
    call tally%is_true(below_resolution(3.0_wp, v, 7.0_wp), "at the resolution")
    call tally%is_true(.not. below_resolution(3.0_wp, 1.001_wp*v, 7.0_wp), "above it")
    call tally%is_true(.not. below_resolution(-3.0_wp, 0.0_wp, 7.0_wp), "not pressed")
  end subroutine test_resolution

  subroutine random_seed_fixed()
    integer :: n
    call random_seed(size=n)
    call random_seed(put=spread(20240229, 1, n))
  end subroutine random_seed_fixed
end program test_chatter
