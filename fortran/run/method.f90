!> The way to move an oscillator, as a caller names it.
module lapwing_run_method
  use lapwing_codes, only: method_exact
  use lapwing_flow, only: flow_t
  use lapwing_flow_exact_exact_flow, only: exact_flow_t, make_exact_flow
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_system_oscillator, only: oscillator_t
  implicit none
  private
  public :: make_flow

contains

  !> A way to move an oscillator.
  subroutine make_flow(method, system, flow, error)
    integer, intent(in) :: method                         !! method_*
    type(oscillator_t), intent(in), target :: system      !! what moves; it must outlive the flow
    class(flow_t), allocatable, intent(out) :: flow       !! how
    integer, intent(out) :: error                         !! 0, or there is no memory for it
    type(exact_flow_t), allocatable :: exact
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
