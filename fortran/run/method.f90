!> Systems and ways to move them, as a caller names them, and the memory they take.
module lapwing_run_method
  use lapwing_kinds, only: wp, int64
  use lapwing_flow_exact_response, only: ordinary_panels, most_panels
  use lapwing_codes, only: method_exact
  use lapwing_flow_exact_exact_flow, only: exact_flow_t, build_exact_flow
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_flow, only: flow_t
  use lapwing_system_oscillator, only: oscillator_t, oscillator
  use lapwing_system_parameters, only: parameters_t
  implicit none
  private
  public :: make_system, make_flow, has_room

  !> Bytes of a panel of the closed form and of a knot of a table, with what goes with each.
  real(wp), parameter :: panel_bytes = 700, knot_bytes = 200
  !> Panels of a table's piece in a graded scene, at most.
  integer, parameter :: graded_panels = 3
  !> A system is copied twice while it is made.
  integer, parameter :: copies = 3

contains

  !> The oscillator.
  subroutine make_system(parameters, knots, coefficients, kinks, series, system)
    type(parameters_t), intent(in) :: parameters          !! dimensionless parameters
    real(wp), intent(in) :: knots(:)                      !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: coefficients(0:, :)           !! (0:5, n) rad per mesh period**k
    logical, intent(in) :: kinks(:)                       !! (n) slope jump at knots(i)
    real(wp), intent(in) :: series(:, :)                  !! (3, terms), first order -1: none
    type(oscillator_t), intent(out) :: system             !! the oscillator
    system = oscillator(parameters, knots, coefficients, kinks, series)
  end subroutine make_system

  !> A way to move it.
  subroutine make_flow(method, system, flow)
    integer, intent(in) :: method                         !! method_*
    type(oscillator_t), intent(in) :: system              !! what moves
    class(flow_t), allocatable, intent(out) :: flow       !! how
    type(exact_flow_t), allocatable :: exact
    if (method == method_exact) then
      allocate (exact)
      call build_exact_flow(system, exact)
      call move_alloc(exact, flow)
    else
      allocate (flow, source=rk4_flow_t(takes_steps=.true.))
    end if
  end subroutine make_flow

  !> Whether there is memory for some systems: tried, since a failed allocation within a copy of a
  !> type would end the process.
  logical function has_room(method, parameters, knots, series, systems)
    integer, intent(in) :: method                         !! method_*
    type(parameters_t), intent(in) :: parameters          !! dimensionless parameters
    real(wp), intent(in) :: knots(:)                      !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: series(:, :)                  !! (3, terms), first order -1: none
    integer, intent(in) :: systems                        !! how many at once
    character, allocatable, volatile :: trial(:)   ! else it may be left out
    real(wp), parameter :: two_pi = 8*atan(1.0_wp)
    real(wp) :: rate, panels
    integer :: error
    associate (p => parameters)
      rate = max(1.0_wp, 2*p%damping_ratio, p%mesh_frequency_ratio*maxval(series(1, :)))
      panels = 0
      if (method == method_exact) panels = min(real(most_panels, wp), &
          ordinary_panels(two_pi/p%mesh_frequency_ratio, rate, 0)) + graded_panels*size(knots)
    end associate
    allocate (trial(int(systems*copies*(panel_bytes*panels + knot_bytes*size(knots)), int64)), &
        stat=error)
    has_room = error == 0
  end function has_room
end module lapwing_run_method
