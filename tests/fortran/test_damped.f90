!> The free damped oscillator in closed form, against the same formula at quadruple precision and
!> against what any solution obeys.
program test_damped
  use, intrinsic :: iso_fortran_env, only: qp => real128
  use assertions, only: tally_t
  use lapwing_system_oscillation, only: damped_t, damped, free_motion, free_matrix, &
      near_matrix, taylor_row, n_taylor
  use lapwing_kinds, only: wp
  implicit none

  type(tally_t) :: tally
  real(wp), parameter :: eps = epsilon(1.0_wp)
  real(wp), parameter :: ratios(9) = [0.0_wp, 0.1_wp, 0.7_wp, 1 - 1.0e-9_wp, 1.0_wp, &
      1 + 1.0e-9_wp, 1.001_wp, 1.3_wp, 50.0_wp]
  real(wp), parameter :: times(16) = [0.0_wp, 1.0e-200_wp, 1.0e-16_wp, 1.0e-9_wp, 1.0e-4_wp, &
      0.01_wp, 0.1_wp, 0.499_wp, 0.501_wp, 1.0_wp, 2.0_wp, 7.0_wp, 30.0_wp, 100.0_wp, 500.0_wp, &
      1.0e4_wp]

  call test_values()
  call test_known_values()
  call test_matrix()
  call test_semigroup()
  call test_size_never_grows()
  call test_taylor()
  call test_near_matrix()
  call tally%finish()

contains

  !> d and e with exponentials and circular or hyperbolic functions of 33 digits.
  subroutine reference(xi, s, d, e, size_d, size_e)
    real(wp), intent(in) :: xi, s                 !! damping ratio, time
    real(qp), intent(out) :: d, e                 !! the two solutions
    real(qp), intent(out) :: size_d, size_e       !! what their rounding is relative to
    real(qp) :: w, x, t
    x = xi
    t = s
    w = sqrt(abs((1 - x)*(1 + x)))
    if (w == 0) then
      d = exp(-t)
      e = t*exp(-t)
    else if (x < 1) then
      d = exp(-x*t)*cos(w*t)
      e = exp(-x*t)*sin(w*t)/w
    else
      d = 0.5_qp*(exp(-t/(x + w)) + exp(-(x + w)*t))
      e = 0.5_qp*(exp(-t/(x + w)) - exp(-(x + w)*t))/w
      if (w*t < 1.0e-6_qp) e = exp(-x*t)*(1 + (w*t)**2/6)*t
    end if
    size_d = d
    size_e = e
    if (x >= 1) return
    size_d = exp(-x*t)
    size_e = min(t, 1/w)*exp(-x*t)
  end subroutine reference

  !> Rounding of the exponents and angles, and of a few operations, relative.
  pure real(wp) function rounding(xi, s)
    real(wp), intent(in) :: xi, s                 !! damping ratio, time
    real(wp) :: w
    w = sqrt(abs((1 - xi)*(1 + xi)))
    if (w*s < 0.5_wp .or. xi < 1) then
      rounding = eps*(6 + 2*(xi + w)*s)
    else
      rounding = eps*(6 + 4*s/(xi + w))
    end if
  end function rounding

  subroutine test_values()
    type(damped_t) :: self
    real(wp) :: d, e
    real(qp) :: exact(2), size(2)
    integer :: i, k
    do i = 1, size_of(ratios)
      self = damped(ratios(i))
      do k = 1, size_of(times)
        call free_motion(self, times(k), d, e)
        call reference(ratios(i), times(k), exact(1), exact(2), size(1), size(2))
        call tally%below(abs(real(d - exact(1), wp)), &
            real(size(1), wp)*rounding(ratios(i), times(k)) + tiny(d), "d"//at(i, k))
        call tally%below(abs(real(e - exact(2), wp)), &
            real(size(2), wp)*rounding(ratios(i), times(k)) + tiny(d), "e"//at(i, k))
      end do
    end do
  end subroutine test_values

  pure integer function size_of(list)
    real(wp), intent(in) :: list(:)               !! any list
    size_of = size(list)
  end function size_of

  !> Which case it is, in words.
  function at(i, k) result(words)
    integer, intent(in) :: i, k                   !! number of the ratio and of the time
    character(60) :: words
    write (words, "(2(a, es16.9))") " at xi", ratios(i), ", s", times(k)
  end function at

  !> x = cos s; x = (1 + s) exp(-s); x = 2 exp(-s/2) - exp(-2 s), over 1, at xi = 5/4.
  subroutine test_known_values()
    real(wp) :: m(2, 2)
    m = free_matrix(damped(0.0_wp), 2.0_wp)
    call tally%near(m(1, 1), -0.41614683654714239_wp, 4*eps, "undamped: cos 2")
    call tally%near(m(1, 2), 0.90929742682568170_wp, 4*eps, "undamped: sin 2")
    m = free_matrix(damped(1.0_wp), 2.0_wp)
    call tally%near(m(1, 1), 0.40600584970983811_wp, 4*eps, "critical: 3 exp(-2)")
    call tally%near(m(1, 2), 0.27067056647322538_wp, 4*eps, "critical: 2 exp(-2)")
    m = free_matrix(damped(1.25_wp), 2.0_wp)
    call tally%near(m(1, 1), (4*0.36787944117144232_wp - 0.018315638888734179_wp)/3, 4*eps, &
        "overdamped: (4 exp(-1) - exp(-4))/3")
  end subroutine test_known_values

  !> Rows: the second is the derivative of the first. Determinant exp(-2 xi s).
  subroutine test_matrix()
    real(wp) :: m(2, 2), xi, s, allowed
    real(qp) :: d, e, sizes(2), x
    integer :: i, k
    do i = 1, size_of(ratios)
      do k = 1, size_of(times)
        xi = ratios(i)
        s = times(k)
        m = free_matrix(damped(xi), s)
        call reference(xi, s, d, e, sizes(1), sizes(2))
        x = xi
        allowed = real(sizes(1) + (1 + x)*sizes(2), wp)*(rounding(xi, s) + 2*eps) + tiny(s)
        call tally%near(m(1, 1), real(d + x*e, wp), allowed, "x of x"//at(i, k))
        call tally%near(m(1, 2), real(e, wp), allowed, "x of x'"//at(i, k))
        call tally%near(m(2, 1), real(-e, wp), allowed, "x' of x"//at(i, k))
        call tally%near(m(2, 2), real(d - x*e, wp), allowed, "x' of x'"//at(i, k))
        allowed = 4*(rounding(xi, s) + 2*eps)*(abs(m(1, 1)) + (1 + xi)*abs(m(1, 2)))**2
        if (xi < 1) allowed = 4*(rounding(xi, s) + 2*eps)*exp(-2*xi*s) &
            *(1 + min(s, 1/damped_w(xi)))**2
        call tally%near(m(1, 1)*m(2, 2) - m(1, 2)*m(2, 1), exp(-2*xi*s), allowed + tiny(s), &
            "determinant"//at(i, k))
      end do
    end do
  end subroutine test_matrix

  pure real(wp) function damped_w(xi)
    real(wp), intent(in) :: xi                    !! damping ratio
    damped_w = sqrt(abs((1 - xi)*(1 + xi)))
  end function damped_w

  !> M(s) M(t) = M(s + t), whichever branches the three take.
  subroutine test_semigroup()
    real(wp), parameter :: part(6) = [1.0e-7_wp, 0.02_wp, 0.3_wp, 0.45_wp, 3.0_wp, 20.0_wp]
    real(wp) :: left(2, 2), right(2, 2), whole(2, 2), size(2, 2), xi
    type(damped_t) :: self
    integer :: i, k, l
    do i = 1, size_of(ratios)
      xi = ratios(i)
      self = damped(xi)
      do k = 1, 6
        do l = 1, 6
          left = free_matrix(self, part(k))
          right = free_matrix(self, part(l))
          whole = free_matrix(self, part(k) + part(l))
          size = sizes(self, part(k), part(l))
          call tally%below(maxval(abs(matmul(left, right) - whole)/size), &
              3*(rounding(xi, part(k) + part(l)) + 4*eps), "semigroup"//at(i, l))
        end do
      end do
    end do
  end subroutine test_semigroup

  !> Sizes of the terms of M(s) M(t): envelopes instead of values that pass zero.
  function sizes(self, s, t) result(total)
    type(damped_t), intent(in) :: self            !! damping
    real(wp), intent(in) :: s, t                  !! two times
    real(wp) :: total(2, 2)
    total = matmul(envelope(self, s), envelope(self, t))
  end function sizes

  function envelope(self, s) result(size)
    type(damped_t), intent(in) :: self            !! damping
    real(wp), intent(in) :: s                     !! time
    real(wp) :: size(2, 2)
    real(qp) :: d, e, sized, sizee
    call reference(self%xi, s, d, e, sized, sizee)
    size = real(sizee, wp)
    size(1, 1) = real(sized + self%xi*sizee, wp)
    size(2, 2) = size(1, 1)
  end function envelope

  !> (x**2 + x'**2)' = -4 xi x'**2: the bound of every contact rests on it.
  subroutine test_size_never_grows()
    real(wp) :: x(2), before, s, angle
    type(damped_t) :: self
    integer :: i, k, l
    do i = 1, size_of(ratios)
      self = damped(ratios(i))
      do k = 0, 7
        angle = 0.4_wp*k
        x = [cos(angle), sin(angle)]
        before = 1
        do l = 1, 40
          s = 0.17_wp*l
          call tally%below(norm2(matmul(free_matrix(self, s), x)), before + 8*eps, &
              "size of a free oscillation"//at(i, 1))
          before = norm2(matmul(free_matrix(self, s), x))
        end do
      end do
    end do
  end subroutine test_size_never_grows

  !> x'' = -2 xi x' - x, term by term, and the series against the motion.
  subroutine test_taylor()
    real(wp) :: row(2, 0:n_taylor), m(2, 2), sum(2), size(2), xi, s, factorial
    integer :: i, k
    do i = 1, size_of(ratios)
      xi = ratios(i)
      row = taylor_row(xi)
      call tally%is_true(all(damped_row(xi) == row), "the row kept with the damping")
      call tally%is_true(all(row(:, 0) == [1.0_wp, 0.0_wp]) &
          .and. all(row(:, 1) == [0.0_wp, 1.0_wp]), "first two Taylor coefficients")
      do k = 0, n_taylor - 2
        sum = (k + 2)*(k + 1)*row(:, k + 2) + 2*xi*(k + 1)*row(:, k + 1) + row(:, k)
        size = 2*xi*(k + 1)*abs(row(:, k + 1)) + abs(row(:, k))
        call tally%below(maxval(abs(sum) - 4*eps*size), 0.0_wp, "Taylor recursion"//at(i, 1))
      end do
      ! What is left out is (2 xi s)**14/14!, below 1e-25.
      s = 0.1_wp/max(1.0_wp, 2*xi)
      sum = 0
      do k = n_taylor, 0, -1
        sum = sum*s + row(:, k)
      end do
      m = free_matrix(damped(xi), s)
      call tally%near(sum(1), m(1, 1), 4*eps, "Taylor series of x from x"//at(i, 1))
      call tally%near(sum(2), m(1, 2), 4*eps*s, "Taylor series of x from x'"//at(i, 1))
    end do
    row = taylor_row(0.0_wp)
    factorial = 1
    do k = 1, n_taylor
      factorial = factorial*k
      call tally%near(row(1 + mod(k, 2), k), merge(-1.0_wp, 1.0_wp, mod(k/2, 2) == 1)/factorial, &
          k*eps/factorial, "cosine or sine series")
      call tally%is_true(row(2 - mod(k, 2), k) == 0, "other parity")
    end do
    row = taylor_row(1.0_wp)
    factorial = 1
    do k = 1, n_taylor
      call tally%near(row(2, k), merge(1.0_wp, -1.0_wp, mod(k, 2) == 1)/factorial, &
          4*k*eps/factorial, "s exp(-s)")
      factorial = factorial*k
    end do
  end subroutine test_taylor

  !> Half a panel forth and back: exp(2 xi s) < 2 is the most that errors grow by on the way back,
  !> and one of the eight roundings of each chain may do that.
  subroutine test_near_matrix()
    real(wp), parameter :: one(2, 2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
    type(damped_t) :: self
    real(wp) :: m(2, 2), s
    integer :: i, k
    do i = 1, size_of(ratios)
      self = damped(ratios(i))
      do k = 0, 65
        s = 0.01_wp*k/max(1.0_wp, 2*ratios(i))
        m = free_matrix(self, s)
        call tally%below(maxval(abs(near_matrix(self, s) - m)), 16*eps, "half a panel"//at(i, 1))
        call tally%below(maxval(abs(matmul(near_matrix(self, -s), m) - one)), 64*eps, &
            "and back"//at(i, 1))
      end do
    end do
  end subroutine test_near_matrix

  function damped_row(xi) result(row)
    real(wp), intent(in) :: xi                    !! damping ratio
    real(wp) :: row(2, 0:n_taylor)
    type(damped_t) :: self
    self = damped(xi)
    row = self%row
  end function damped_row
end program test_damped
