!> Steady response of contact and its panels: the equation over every panel in quadruple precision,
!> the jumps, the period, and what the Bernstein coefficients promise.
program test_closed_form
  use assertions, only: tally_t
  use exact_reference, only: qp, seed, uniform, random_scene, table_scene, &
      quad_flank, quad_flow, amplification, largest_term
  use lapwing_flank_fixed, only: fixed_flank_t
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree, horner
  use lapwing_flow_exact_curve, only: scene_t, is_smooth
  use lapwing_flow_exact_panels, only: locate_panel, free_size
  implicit none

  type(tally_t) :: tally
  real(wp), parameter :: eps = epsilon(1.0_wp)
  integer, parameter :: n_scenes = 300

  call seed(20261123)
  call test_response()
  call test_parabola()
  call test_flat_resonant()
  call test_enclosures()
  call test_locate_panel()
  call tally%finish()

contains

  !> Sizes of what the response is the sum of, and its amplification, in EPS: response and free
  !> part are of a size with the response; 1 is the size of g.
  real(wp) function rounding(scene)
    type(scene_t), intent(in) :: scene   !! scene
    real(wp) :: bend
    bend = 1 + largest_term(scene, 2)
    rounding = eps*(200 + 10*scene%form%n)*(bend + amplification(scene))
  end function rounding

  !> From panel to panel by the differential equation; all jumps in place; back after a period.
  subroutine test_response()
    type(scene_t) :: scene
    real(qp) :: x, v, jump
    real(wp) :: allowed, worst
    integer :: i, panel, next
    worst = 0
    do i = 1, n_scenes
      call random_scene(mod(i, 3) == 0, 0.5_wp, scene)
      scene%force = 0
      allowed = rounding(scene)
      associate (form => scene%form)
        do panel = 1, form%n
          next = 1 + mod(panel, form%n)
          associate (here => form%panel(panel), there => form%panel(next))
            x = here%q_begin(1)
            v = here%q_begin(2)
            call quad_flow(scene, .true., form%piece(panel), real(form%edge(panel), qp), &
                real(form%edge(panel + 1), qp) - form%edge(panel), x, v)
            call tally%near(here%q_end(1), real(x, wp), allowed, "response after a panel")
            call tally%near(here%q_end(2), real(v, wp), allowed, "its rate after a panel")
            worst = max(worst, abs(real(here%q_end(1) - x, wp))/allowed)
            jump = 0
            if (form%piece(next) /= form%piece(panel) .or. next == 1) then
              jump = slope_jump(scene, form%piece(panel), form%piece(next))
            end if
            call tally%near(there%q_begin(1), here%q_end(1), allowed, &
                "response over a panel's end")
            call tally%near(there%q_begin(2) - here%q_end(2), -real(jump, wp), allowed, &
                "jump of its rate")
          end associate
        end do
      end associate
    end do
    print "(a, f6.3)", "measured: error of the response over what is allowed, at most ", worst
  end subroutine test_response

  !> g'(after) - g'(before) between two table pieces.
  real(qp) function slope_jump(scene, before, after)
    type(scene_t), intent(in) :: scene       !! scene
    integer, intent(in) :: before, after     !! pieces
    real(qp) :: g(0:30), h(0:30)
    g = quad_flank(scene, before, real(scene%flank%knot(before + 1), qp))
    h = quad_flank(scene, after, real(scene%flank%knot(after), qp))
    slope_jump = h(1) - g(1)
  end function slope_jump

  !> g = -4A(u - 1/2)**2: q = 8A/P**2 - (8A/P)/w Im(exp(l s)/(1 - exp(l P))), l = -xi + i w, the
  !> impulse responses to all kinks before summed as a geometric series.
  subroutine test_parabola()
    real(wp), parameter :: xi = 0.1_wp, period = 11.3_wp
    real(wp) :: coefficients(0:5, 1), w, s, exact
    complex(wp) :: lambda
    type(scene_t) :: scene
    integer :: panel
    coefficients(:, 1) = [-1.0_wp, 4.0_wp, -4.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    scene = table_scene([0.0_wp, 1.0_wp], coefficients, [.true.], period, xi, 0.0_wp)
    w = sqrt(1 - xi**2)
    lambda = cmplx(-xi, w, wp)
    do panel = 1, scene%form%n
      s = scene%form%edge(panel)
      exact = 8/period**2 - 8/period/w*aimag(exp(lambda*s)/(1 - exp(lambda*period)))
      call tally%near(scene%form%panel(panel)%q_begin(1), exact, 32*eps, "response to a parabola")
    end do
  end subroutine test_parabola

  !> Undamped and exactly resonant, but nothing drives it: no response, and no division by zero.
  subroutine test_flat_resonant()
    real(wp) :: coefficients(0:5, 1)
    type(scene_t) :: scene
    integer :: i
    coefficients = 0
    scene = table_scene([0.0_wp, 1.0_wp], coefficients, [.false.], 8*atan(1.0_wp), 0.0_wp, 1.0_wp)
    do i = 1, scene%form%n
      call tally%is_true(all(scene%form%panel(i)%q == 0), "no response where nothing drives it")
    end do
    call tally%is_true(scene%form%q_low == 0 .and. scene%form%q_high == 0, "bounds of nothing")
  end subroutine test_flat_resonant

  !> Polynomial in Bernstein form at x in [0, 1], de Casteljau.
  pure real(wp) function casteljau(b, x)
    real(wp), intent(in) :: b(0:max_degree)  !! coefficients
    real(wp), intent(in) :: x                !! place
    real(wp) :: c(0:max_degree)
    integer :: i
    c = b
    do i = 1, max_degree
      c(0:max_degree - i) = (1 - x)*c(0:max_degree - i) + x*c(1:max_degree - i + 1)
    end do
    casteljau = c(0)
  end function casteljau

  !> On every panel q, g and free oscillations lie within `rest` of their polynomials, and so
  !> between the least and the largest coefficient but for that.
  subroutine test_enclosures()
    type(scene_t) :: scene
    real(wp) :: allowed, x, width
    integer :: i, k, panel
    do i = 1, n_scenes
      call random_scene(mod(i, 3) == 0, 0.5_wp, scene)
      scene%force = 0
      allowed = rounding(scene)
      do panel = 1, scene%form%n
        width = scene%form%edge(panel + 1) - scene%form%edge(panel)
        do k = 0, 5
          x = 0.2_wp*k
          if (k /= 0 .and. k /= 5) x = uniform(0.0_wp, 1.0_wp)
          call check_panel(scene, panel, x, x*width, allowed)
        end do
      end do
    end do
  end subroutine test_enclosures

  subroutine check_panel(scene, panel, x, s, allowed)
    type(scene_t), intent(in) :: scene   !! scene
    integer, intent(in) :: panel         !! panel
    real(wp), intent(in) :: x, s         !! place in it, 0 to 1 and in tau
    real(wp), intent(in) :: allowed      !! rounding
    real(qp) :: q, v, g(0:30)
    associate (form => scene%form, here => scene%form%panel(panel))
      q = here%q_begin(1)
      v = here%q_begin(2)
      call quad_flow(scene, .true., form%piece(panel), real(form%edge(panel), qp), &
          real(s, qp), q, v)
      call enclosed(real(q, wp), x, here%q_bernstein, here%q_rest, allowed, "q")
      call tally%near(horner(here%q, form%edge(panel) + s - here%middle), real(q, wp), allowed, &
          "q by its series")
      call tally%below(real(q, wp), form%q_high + allowed, "upper bound of q")
      call tally%below(-real(q, wp), -form%q_low + allowed, "lower bound of q")
      call check_free_part(scene, panel, x, s)
      if (.not. is_smooth(scene%flank)) return
      g = quad_flank(scene, 1, form%edge(panel) + real(s, qp))
      call enclosed(real(g(0), wp), x, here%g_bernstein, here%g_rest, 64*eps, "g")
      call tally%near(horner(here%g, form%edge(panel) + s - here%middle), real(g(0), wp), 64*eps, &
          "g by its series")
      call tally%below(here%g_rest, 0.01_wp, "what is left out of g")
      call tally%below(real(g(0), wp), min(form%g_high, here%g_high) + 64*eps, "upper bound of g")
      call tally%below(-real(g(0), wp), -max(form%g_low, here%g_low) + 64*eps, "lower bound of g")
    end associate
  end subroutine check_panel

  subroutine check_free_part(scene, panel, x, s)
    type(scene_t), intent(in) :: scene   !! scene
    integer, intent(in) :: panel         !! panel
    real(wp), intent(in) :: x, s         !! place in it, 0 to 1 and in tau
    type(scene_t) :: still
    type(fixed_flank_t), target :: fixed
    real(qp) :: d, d_rate, middle(2)
    real(wp) :: free(2), moved(2)
    still%flank => fixed
    still%force = scene%force
    still%form%damping = scene%form%damping
    associate (form => scene%form, here => scene%form%panel(panel))
      d = uniform(-1.0_wp, 1.0_wp)
      d_rate = uniform(-1.0_wp, 1.0_wp)
      middle = [d, d_rate]
      call quad_flow(still, .true., 1, 0.0_qp, real(here%half, qp), middle(1), middle(2))
      free = real(middle, wp)
      call quad_flow(still, .true., 1, 0.0_qp, real(s, qp), d, d_rate)
      call enclosed(real(d, wp), x, matmul(here%d_bernstein, free), &
          here%d_rest*free_size(free), 64*eps, "d")
      ! A bound of no use would hold too. With panels of 1.5, and |x^(6)| <= (1 + 2 xi)**5:
      call tally%below(here%d_rest, 0.75_wp**6/720*(1 + 2*form%damping%xi)**5*2, &
          "what is left out of d")
      if (x /= 1 .or. panel == form%n) return
      call quad_flow(still, .true., 1, 0.0_qp, &
          real(form%panel(panel + 1)%middle, qp) - here%middle, middle(1), middle(2))
      moved = matmul(here%d_matrix, free)
      call tally%near(moved(1), real(middle(1), wp), 16*eps, "d from middle to middle")
      call tally%near(moved(2), real(middle(2), wp), 16*eps, "d' from middle to middle")
    end associate
  end subroutine check_free_part

  subroutine enclosed(value, x, b, rest, allowed, what)
    real(wp), intent(in) :: value             !! value
    real(wp), intent(in) :: x                 !! place in the panel
    real(wp), intent(in) :: b(0:max_degree)   !! its polynomial
    real(wp), intent(in) :: rest, allowed     !! what it leaves out; rounding
    character(*), intent(in) :: what          !! in words
    call tally%near(casteljau(b, x), value, rest + allowed, what//" against its polynomial")
    call tally%below(value, maxval(b) + rest + allowed, what//" below its upper bound")
    call tally%below(-value, -minval(b) + rest + allowed, what//" above its lower bound")
  end subroutine enclosed

  !> At an edge the panel that begins there, a bit before it the one that ends.
  subroutine test_locate_panel()
    type(scene_t) :: scene
    integer :: i, k, panel
    real(wp) :: t
    do i = 1, n_scenes
      call random_scene(mod(i, 3) == 0, 0.5_wp, scene)
      associate (form => scene%form)
        call tally%near(form%edge(1), 0.0_wp, 0.0_wp, "first edge")
        call tally%near(form%edge(form%n + 1), form%period, 0.0_wp, "last edge")
        do panel = 1, form%n
          call tally%equal(locate_panel(form, form%edge(panel)), panel, "panel at its edge")
          call tally%equal(locate_panel(form, nearest(form%edge(panel + 1), -1.0_wp)), panel, &
              "panel just before its end")
          call tally%below(scene%flank%knot(form%piece(panel)), form%edge(panel), "piece begins")
          call tally%below(form%edge(panel + 1), scene%flank%knot(form%piece(panel) + 1), &
              "piece ends")
        end do
        call tally%equal(locate_panel(form, form%period), form%n, "panel at the period's end")
        do k = 1, 20
          t = uniform(0.0_wp, form%period)
          panel = locate_panel(form, t)
          call tally%is_true(form%edge(panel) <= t .and. t < form%edge(panel + 1), &
              "panel that holds a time")
        end do
      end associate
    end do
  end subroutine test_locate_panel
end program test_closed_form
