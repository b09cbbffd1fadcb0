!> Every code that leaves the engine, named once; `lapwing.base.codes` mirrors it in Python.
module lapwing_codes
  implicit none
  private
  public :: separation, engagement, back_engagement
  public :: no_flank, drive_flank, coast_flank
  public :: law_restitution, law_compliant, law_rigid
  public :: law_relative, law_absolute
  public :: method_rk4, method_exact
  public :: gap_one_sided, gap_symmetric, gap_one_flank
  public :: event_impact, event_release, event_engage, event_chatter_end, event_kink
  public :: event_near_graze, event_kind
  public :: status_ok, status_too_many_events, status_too_many_steps
  public :: status_step_too_small, status_not_finite, status_unfinished, status_out_of_memory
  public :: end_unknown, end_certain, end_presumed
  public :: all_codes

  ! Motion states
  integer, parameter :: separation = 0
  integer, parameter :: engagement = 1
  integer, parameter :: back_engagement = 2

  ! Flanks. A contact state has the number of its flank.
  integer, parameter :: no_flank = 0
  integer, parameter :: drive_flank = 1
  integer, parameter :: coast_flank = 2

  ! Contact laws
  integer, parameter :: law_restitution = 1
  integer, parameter :: law_compliant = 2
  integer, parameter :: law_rigid = 3

  ! Impact laws
  integer, parameter :: law_relative = 1
  integer, parameter :: law_absolute = 2

  ! Ways of moving along a smooth piece
  integer, parameter :: method_rk4 = 1
  integer, parameter :: method_exact = 2

  ! Gaps
  integer, parameter :: gap_one_sided = 1
  integer, parameter :: gap_symmetric = 2
  integer, parameter :: gap_one_flank = 3

  ! Event kinds at the drive flank; the same kind at the coast flank is one more (`event_kind`).
  integer, parameter :: event_impact = 1
  integer, parameter :: event_release = 3
  integer, parameter :: event_engage = 5
  integer, parameter :: event_chatter_end = 7
  integer, parameter :: event_kink = 9
  integer, parameter :: event_near_graze = 10

  ! How a run ended
  integer, parameter :: status_ok = 0
  integer, parameter :: status_too_many_events = 1
  integer, parameter :: status_too_many_steps = 2
  integer, parameter :: status_step_too_small = 3
  integer, parameter :: status_not_finite = 4
  integer, parameter :: status_unfinished = 5
  integer, parameter :: status_out_of_memory = 6

  ! How sure it is where a motion ends
  integer, parameter :: end_unknown = 0
  integer, parameter :: end_certain = 1
  integer, parameter :: end_presumed = 2

  !> All of them, in the order of `lapwing.base.codes`, for the test that both sides agree.
  integer, parameter :: all_codes(*) = [separation, engagement, back_engagement, &
      no_flank, drive_flank, coast_flank, event_impact, event_impact + 1, event_release, &
      event_release + 1, event_engage, event_engage + 1, event_chatter_end, &
      event_chatter_end + 1, event_kink, event_near_graze, event_near_graze + 1, &
      law_restitution, law_compliant, law_rigid, law_relative, law_absolute, gap_one_sided, &
      gap_symmetric, gap_one_flank, status_ok, status_too_many_events, status_too_many_steps, &
      status_step_too_small, status_not_finite, status_unfinished, status_out_of_memory, &
      method_rk4, method_exact, end_unknown, end_certain, end_presumed]

contains

  !> Code of an event of kind `base` at a flank.
  elemental integer function event_kind(base, flank)
    integer, intent(in) :: base   !! kind at the drive flank
    integer, intent(in) :: flank  !! drive_flank or coast_flank
    event_kind = base + (flank - drive_flank)
  end function event_kind
end module lapwing_codes
