!> Systems and ways to move them, as a caller names them.
module lapwing_run_method
  use lapwing_codes, only: method_exact
  use lapwing_flow, only: flow_t
  use lapwing_flow_exact_exact_flow, only: exact_flow_t, make_exact_flow
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_kinds, only: wp
  use lapwing_system_oscillator, only: oscillator_t, make_oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_system_torsional_chain, only: torsional_chain_t, make_torsional_chain
  implicit none
  private
  public :: make_system, make_flow

contains

  !> The oscillator, or both wheels as bodies.
  subroutine make_system(parameters, knots, coefficients, kinks, series, system, error)
    type(parameters_t), intent(in) :: parameters          !! dimensionless parameters
    real(wp), intent(in) :: knots(:)                      !! (n + 1) mesh phase, 0 to 1
    real(wp), intent(in) :: coefficients(0:, :)           !! (0:5, n) rad per mesh period**k
    logical, intent(in) :: kinks(:)                       !! (n) slope jump at knots(i)
    real(wp), intent(in) :: series(:, :)                  !! (3, terms), first order -1: none
    class(oscillator_t), allocatable, intent(out) :: system   !! the system
    integer, intent(out) :: error                         !! 0, or there is no memory for it
    type(oscillator_t), allocatable :: alone
    type(torsional_chain_t), allocatable :: chain
    if (parameters%degrees_of_freedom == 2) then
      allocate (chain)
      call make_torsional_chain(parameters, knots, coefficients, kinks, series, chain, error)
      call move_alloc(chain, system)
    else
      allocate (alone)
      call make_oscillator(parameters, knots, coefficients, kinks, series, alone, error)
      call move_alloc(alone, system)
    end if
  end subroutine make_system

  !> A way to move it; in closed form the oscillator alone.
  subroutine make_flow(method, system, flow, error)
    integer, intent(in) :: method                         !! method_*
    class(oscillator_t), intent(in), target :: system     !! what moves; it must outlive the flow
    class(flow_t), allocatable, intent(out), target :: flow   !! how
    integer, intent(out) :: error                         !! 0, or there is no memory for it
    type(exact_flow_t), allocatable, target :: exact
    error = 0
    if (method == method_exact) then
      allocate (exact)
      call make_exact_flow(system, exact, error)
      call move_alloc(exact, flow)
    else
      allocate (rk4_flow_t :: flow)
    end if
  end subroutine make_flow
end module lapwing_run_method
