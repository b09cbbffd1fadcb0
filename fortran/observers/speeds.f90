!> How often impacts of which speed happen: counts in bins of equal ratio, added up as they happen,
!> so that the memory is that of the picture and not of the impacts.
module lapwing_observers_speeds
  use lapwing_kinds, only: wp
  use lapwing_codes, only: coast_flank, event_impact, event_kind
  use lapwing_hybrid_state, only: event_t
  implicit none
  private
  public :: speed_density_t, count_speed

  !> The first bin takes what is slower than `low`, the last what is not slower than `high`.
  type :: speed_density_t
    real(wp) :: low = 1                                       !! rad per tau, > 0
    real(wp) :: high = 2                                      !! rad per tau, > low
    real(wp), pointer, contiguous :: counts(:) => null()      !! (bins + 2); null: not wanted
  end type speed_density_t

contains

  !> Count an event if it is an impact and counts are wanted.
  subroutine count_speed(self, event)
    type(speed_density_t), intent(inout) :: self
    type(event_t), intent(in) :: event           !! any event
    real(wp) :: place
    integer :: bins, i
    if (.not. associated(self%counts)) return
    if (event%kind > event_kind(event_impact, coast_flank)) return
    bins = size(self%counts) - 2
    i = 1
    if (abs(event%before) >= self%low) then
      place = bins*log(abs(event%before)/self%low)/log(self%high/self%low)
      i = 2 + min(int(place), bins)
    end if
    self%counts(i) = self%counts(i) + 1
  end subroutine count_speed
end module lapwing_observers_speeds
